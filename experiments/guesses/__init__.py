"""What the columns of somebody's log may be: guessed from names, numbers and what the model predicts."""
