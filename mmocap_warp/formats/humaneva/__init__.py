"""HumanEva-I, from a user's own copy."""
