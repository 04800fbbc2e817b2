"""Check of a certificate of a swarm's flight: no meeting, and a rule that was kept."""
