"""`kneejax joint`: arguments, and a file for each of its commands."""

from kneejax.cli.joint._arguments import add_joint as add_joint
