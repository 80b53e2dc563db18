"""`kneejax reproduce`: a file a paper."""
