"""The knee file: its fields, reading, writing, mirroring."""
