"""The statement of a lower bound and its answer with the evidence, for all proofs."""

from swarmstart.ocp.lower_bound.stated.answer import Evidence

__all__ = ["Evidence"]
