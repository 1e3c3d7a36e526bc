"""The Guise application: commands, media, enrolment, pipeline."""
