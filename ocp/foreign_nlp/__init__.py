"""Warm starts for NLPs that a user has written with CasADi's Opti or nlpsol.

A search varies the controls of the given NLP; the best ones become a start of it.
"""
