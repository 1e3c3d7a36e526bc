"""Enrolment: from clips of a person to a model of them."""
