"""What may be wrong with a model, a recording or a set-up."""
