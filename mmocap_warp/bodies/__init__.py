"""How the shipped bodies are made from MakeHuman's data."""
