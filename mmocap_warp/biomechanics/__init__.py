"""What biomechanics asks of a result: joint angles, contacts and steps, centre of mass, lengths. docs/measures.md."""
