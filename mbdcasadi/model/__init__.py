"""What a user writes a model with: symbols, bodies, joints, drivers, forces, conditions, mechanisms."""
