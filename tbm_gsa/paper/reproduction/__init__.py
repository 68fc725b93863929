"""The paper's tables and figures from the system, each beside the paper's value or statement."""
