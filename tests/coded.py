"""Findings of an estimate by their code."""


def coded(estimate, *codes):
    """Findings of these codes, in the order in which they are reported."""
    return [finding for finding in estimate.findings if finding.code in codes]


def doubts_of(estimate):
    """Values of the doubts by their codes; one for each code."""
    return {finding.code: finding.values for finding in estimate.findings if finding.doubt}
