"""Commands about Guise itself: the demonstration, the check of this computer, the stage timings."""
