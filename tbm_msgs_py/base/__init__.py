"""What everything stands on: errors, units, the operating point, texts, files, strict YAML, validation, arrays."""
