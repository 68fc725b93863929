"""What everything stands on: errors, units, the operating point, strict YAML, arrays, files written whole."""
