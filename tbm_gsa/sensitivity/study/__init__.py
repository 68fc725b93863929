"""A sensitivity study: uncertain inputs, design, campaign of simulations, store, analysis."""
