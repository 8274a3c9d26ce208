"""Long runs: who works on them, and how they are interrupted and resumed."""
