"""Parts of a model: symbols, bodies, joints, drivers, forces, conditions, mechanisms."""
