"""What a problem says: phases, conditions, costs, and whether they agree."""
