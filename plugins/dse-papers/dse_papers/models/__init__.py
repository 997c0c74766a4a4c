"""Model families of papers: HOTS and its time surfaces, cascades of two networks, threshold LIF outputs."""

from dse_papers.models import cascade, hots, threshold_lif

__all__ = ["cascade", "hots", "threshold_lif"]
