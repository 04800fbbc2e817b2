"""The statement of a lower bound and its evidence, which all of its proofs share."""
