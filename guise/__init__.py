"""Guise: face swap and video de-identification on an ordinary CPU, with Active Appearance Models."""
