"""The load model `cutter`: discs on the head, the forces of the rock on each, their sum."""
