"""The stages of a de-identification: each reads what the ones before wrote."""
