"""Results as other programs read them, and what they wrote as ours."""
