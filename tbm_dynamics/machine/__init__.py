"""The machine: its file, validated, and the inputs that a study or an update changes."""
