"""Long runs: their workers, interruption and resumption."""
