"""What the paper says, and its tables and figures from the system beside it."""
