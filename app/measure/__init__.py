"""How private and how useful a de-identified video is, measured against its original."""
