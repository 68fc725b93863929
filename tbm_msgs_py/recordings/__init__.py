"""What a recording says: acceleration of test points, operating points, and what is wrong with either."""
