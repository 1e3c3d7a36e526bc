"""Swapping people in videos and photos: what is done to whom, covers, donors, the session that draws, whole files."""

# what a user may give where a face is asked for, see `guise.app.swapping.donors.open_face`
FACE_HELP = (
    "NAME.guise, a photo, a name of `guise people list`, or a fictional face: Luca, Amara, Mei, Walter, Kofi, Elena, "
    "Kenji, Asha, Omar"
)
LANDMARKER_HELP = "Landmarker: builtin (default) or CARD.toml[@DETECTOR]."
