"""From motions to a trajectory: chaining, files, and how far it is from the truth."""
