"""Check of a certificate of a swarm's flight.

The certificate states that no two vehicles come too near, and that plans followed the
rule of proposing, accepting and committing.
"""
