"""Ground floor: errors, units, the operating point, texts, files, strict YAML, validation, arrays, filter."""
