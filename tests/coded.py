"""Findings of an estimate by their code."""


def coded(estimate, *codes):
    """Findings of these codes, in the order in which they are reported."""
    return [finding for finding in estimate.findings if finding.code in codes]
