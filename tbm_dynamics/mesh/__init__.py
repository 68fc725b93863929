"""The pinion–ring meshes: geometry, stiffness pattern, error."""
