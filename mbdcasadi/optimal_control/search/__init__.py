"""The search for a solution: guesses, variants of the program, meshes."""
