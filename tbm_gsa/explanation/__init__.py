"""Which values of the inputs explain a recording: a comparison and a campaign → causes with their probabilities."""
