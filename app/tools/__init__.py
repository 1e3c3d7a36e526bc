"""Work behind the commands about Guise itself: demo, doctor and bench."""
