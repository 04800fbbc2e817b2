"""Warm starts for NLPs that a user has written with CasADi's Opti or nlpsol.

The control sequences are found in the given NLP, searched, and handed back to it.
"""
