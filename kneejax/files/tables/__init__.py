"""Tables: poses, candidate tests, any rows as CSV; OpenSim's .sto and .mot."""
