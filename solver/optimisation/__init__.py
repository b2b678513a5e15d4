"""What is minimised and how: data terms, priors, and the iterations."""
