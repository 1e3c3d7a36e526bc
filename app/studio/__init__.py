"""The studio: Guise in the browser, for one person on this computer."""
