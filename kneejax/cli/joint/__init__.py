"""`kneejax joint`: a file for each of its commands."""
