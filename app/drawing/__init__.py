"""Drawing one face over another: a look, a plan made of it and of two people, and passes that run over each frame."""
