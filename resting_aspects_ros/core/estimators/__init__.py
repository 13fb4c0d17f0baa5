"""What the literature predicts from a part's shape alone, without a drop."""
