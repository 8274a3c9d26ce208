"""A person who bows on a force plate: estimators compared on a real recording."""
