"""All that is precomputed for a person, a donor and a look, and the passes that draw one over the other, in order.

A look is nothing but the passes that are listed here for it; none of them knows of looks, or of another.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np

from guise.aam.appearance import AppearanceModel
from guise.aam.beard import LIMITS as BEARD_LIMITS
from guise.aam.beard import beard
from guise.aam.even_light import even_texture
from guise.aam.extrapolation import DEFAULT_GATE, Extrapolator
from guise.aam.glasses import GlassesOnHead, WornGlasses
from guise.aam.irises import EYES, Irises
from guise.aam.landmarks.schemes import INNER_LIPS, LEFT_BROW, RIGHT_BROW
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.model import Identity
from guise.aam.reference import ReferenceFrame
from guise.aam.relief import Relief
from guise.aam.shape_transfer import ShapeTransfer
from guise.aam.skin_tone import toned
from guise.aam.solid_shape import SolidFit
from guise.aam.view_prior import SideViews
from guise.app.drawing.donor import Donor
from guise.app.drawing.face import BROW_REACH, FEATHER, FaceInFrame
from guise.app.drawing.look import Kind, Look
from guise.app.drawing.memory import Memory
from guise.app.drawing.passes.blend import Blend
from guise.app.drawing.passes.brows import DrawnBrows, HeadBrows
from guise.app.drawing.passes.cover import Arms, Cover, DonorGlasses, shown_mask
from guise.app.drawing.passes.eyes import Apertures, Eyeballs, LidCloser
from guise.app.drawing.passes.forehead import Hairline, outward
from guise.app.drawing.passes.irises import Gaze, IrisChange, IrisTint
from guise.app.drawing.passes.light import QuotientLight
from guise.app.drawing.passes.paper_light import PaperLight
from guise.app.drawing.passes.place import Place, RigidPlace
from guise.app.drawing.passes.shades import FrameShades
from guise.app.drawing.passes.surface import Finish, OwnSkin, PoreFinish
from guise.app.drawing.passes.texture import Enlargement, PlainTexture, Texture
from guise.app.drawing.passes.turned import Folds, Silhouette, whole_cosines
from guise.app.drawing.person import TrackedPerson
from guise.common.arrays import F32, F64
from guise.common.tuned import tuned
from guise.render import feather

Step = Callable[
    [FaceInFrame, Memory], None
]  # of a pass: it completes the face, draws on its canvas, or remembers

NARROW_FEATHER = FEATHER / 2  # in a disguise and with the papers' formulas: less of the own rim shows
MAX_TEXTURE_DEVIATIONS = tuned(4.0, "deviations", "transfer")  # of the target's modes of appearance


@dataclass(frozen=True, eq=False)
class Plan:
    """How one face is drawn over another.

    Parameters
    ----------
    look : Look.   person, donor : Identity, as they are used.
    texture : makes the donor's texture, with the alpha of the look.
    blend : holds the compositors.
    rest : SolidFit of the person at rest; None if the look doesn't ask how heads are turned.
    seeing : passes that tell what a frame shows.
    placing : passes that tell how and where the face is drawn.
    drawing : passes that draw it.
    """

    look: Look
    person: Identity
    donor: Identity
    texture: PlainTexture
    blend: Blend
    rest: SolidFit | None
    seeing: tuple[Step, ...]
    placing: tuple[Step, ...]
    drawing: tuple[Step, ...]

    @classmethod
    def of(cls, person: Identity, donor: Donor, look: Look) -> Plan:
        """The plan for a person in the video and the face that is shown.

        Raises
        ------
        ReferenceMismatchError
            When the two don't share a reference frame.
        RendererError
            When the chosen renderer isn't available.
        """
        resolution = donor.enrolled.appearance.reference.resolution
        return _PLANS[look.kind](TrackedPerson.of(person, resolution), donor, look)


def _fitted(person: TrackedPerson, donor: Donor, shown: AppearanceModel, look: Look) -> Texture:
    """The texture of a donor, as they are shown beside a person, who is fitted into the head of that person."""
    own, relief = person.identity.appearance, Relief.shipped(person.identity.reference)
    transfer = ShapeTransfer(person.solid, donor.solid, own.reference, outline=look.outline, apart=look.apart)
    skin = skin_mask(own.reference)[own.reference.mask]
    theirs, shade = (np.log(np.maximum(one.neutral_texture[skin], 1)).mean(0) for one in (own, shown))
    tone = np.asarray(np.exp(shade - theirs), np.float32)
    extrapolator = Extrapolator(
        own, shown, look.alpha, max_deviations=MAX_TEXTURE_DEVIATIONS, moving=donor.moving, tone=tone
    )
    sides = SideViews.of(shown, donor.clean.views, donor.solid.rest)
    return Texture(
        extrapolator, person.estimator, transfer, sides, relief, whole_cosines(relief), donor.across
    )


def _seeing(
    texture: Texture, cover: Cover, silhouette: Silhouette, person: TrackedPerson
) -> tuple[Step, ...]:
    """What tells where a head's features are in a frame, what is in front of them, and what they express."""
    brows, lids = HeadBrows(person.identity.appearance), LidCloser()
    return (
        brows.follow, texture.look, cover.look, silhouette.hide_texels, texture.measure, brows.see, lids.see,
        lids.close, texture.synthesise,
    )  # fmt: skip


def _iris_change(person: TrackedPerson, donor: Donor, rgb: F32) -> IrisChange | None:
    """From the person's irises to those in the donor's texture (n, 3); None if their clip doesn't tell their colour."""
    theirs = Irises.at_rest(person.identity.reference, donor.at_rest, rgb)
    change = IrisChange(person.irises, theirs.in_human_range())
    return change if change.is_known(donor.eye_pixels) else None


def _swap(person: TrackedPerson, donor: Donor, look: Look, *, shows_skin: bool = True) -> Plan:
    """A donor's face in the light of the scene, with what is in front of the person's and their gaze.

    shows_skin : with the fine structure of the person's skin.
    """
    own, reference = person.identity.appearance, person.identity.reference
    even = own.with_neutral_texture(even_texture(person.identity))
    own_beard, goes_on = beard(person.identity.rest_frame, reference)
    beards = np.zeros_like(own_beard) if goes_on else np.maximum(own_beard, donor.beard)
    shown = _in_tone_of(person, donor, even, 1 - beards, shows_skin=shows_skin)
    relief, rgb = Relief.shipped(reference), shown.neutral_texture
    texture = _fitted(person, donor, shown, look)
    mask, texels = reference.mask, person.texels
    own_eyes = EYES if look.eyes == "source" else ()
    own_mouth = (INNER_LIPS,) if look.mouth == "source" else ()
    irises = _iris_change(person, donor, rgb) if own_eyes else None
    tint = partial(IrisTint, irises) if irises else None
    eyeballs = _painted_eyes(person, donor, rgb) if look.eyes == "painted" else ()
    light = QuotientLight(reference, texels, mask, (even.neutral_texture, rgb))
    hairline = Hairline(reference, rgb, look.forehead) if look.forehead > 0 else None
    detail = donor.clean.detail
    enlargement = Enlargement(hairline.forehead.detailed(detail) if hairline else detail, cv2.INTER_CUBIC)
    cover = Cover(
        reference,
        person.estimator.sampler,
        only_objects=look.in_front != "all",
        keeps_hair=look.in_front == "hair",
        keeps_glasses=look.glasses == "own",
        beyond=hairline.forehead.added if hairline else None,
        watches_eyes=look.eyes != "donor",
        beard=own_beard,
    )
    beyond = outward(reference, look.jaw, look.forehead) + _over_beard(
        np.minimum(own_beard, beards), look, reference
    )
    place = Place(reference, beyond)
    silhouette, folds = Silhouette(relief, texels), Folds(relief)
    surface = (Finish if shows_skin else PoreFinish)(reference, mask)
    skin = (OwnSkin(relief).add,) if shows_skin else ()
    shaded = () if shows_skin else (FrameShades(relief).apply,)
    theirs, drawn = ((), EYES) if eyeballs else (EYES, ())  # lids of shut eyes
    apertures = Apertures(reference, person.at_rest, (*own_eyes, *own_mouth), theirs, tint, drawn)
    drawn_brows = DrawnBrows(reference)
    alpha = _alpha(reference, FEATHER if shows_skin else NARROW_FEATHER, beards)
    blend, rest = Blend(relief, alpha, look.renderer), texture.transfer.source
    arms = () if shows_skin or look.glasses == "own" else (Arms().cover,)
    looks = (Gaze(irises.source, person.at_rest).follow,) if irises else ()
    glasses = _glasses(donor, texture.transfer, reference) if look.glasses == "keep" else ()
    seeing = _seeing(texture, cover, silhouette, person)
    placing = (
        place.lay, *looks, *eyeballs, light.measure, cover.share, *((place.pull_jaw,) if look.outline > 0 else ()),
        *arms, silhouette.share, enlargement.choose, blend.spread, blend.begin,
    )  # fmt: skip
    drawing = (
        cover.rims, folds.find, light.apply, blend.scatter, *((hairline.draw,) if hairline else ()),
        *shaded, surface.sharpen, folds.smooth, enlargement.enlarge, drawn_brows.keep_thick, surface.add_grain,
        surface.look, *skin, apertures.draw, drawn_brows.cover_own, blend.composite, folds.soften_edges,
        surface.compare, blend.write, *glasses,
    )  # fmt: skip
    return Plan(look, person.identity, donor.clean, texture, blend, rest, seeing, placing, drawing)


def _in_tone_of(
    person: TrackedPerson, donor: Donor, even: AppearanceModel, bare: F32, *, shows_skin: bool
) -> AppearanceModel:
    """A donor's face fit for the contrast and tone of a person in even light.

    bare : (h, w) share in [0, 1] of skin without a beard.
    """
    if shows_skin:
        of_photo = person.identity.is_of_photo or donor.enrolled.is_of_photo
        return toned(donor.clean.appearance, even, rim=bare, shades="all" if of_photo else "own")
    # Brows move farther from where theirs were, and the end of one is no shade.
    brows = soft_parts(person.identity.reference, (RIGHT_BROW, LEFT_BROW), BROW_REACH)
    return toned(donor.clean.appearance, even, rim=bare * (1 - brows), shades="colour")


def _alpha(reference: ReferenceFrame, edge: float, beards: F32) -> F32:
    """(h, w) by which the face is drawn, with a soft edge in face widths, where beards (h, w) end a narrower one."""
    wide, narrow = (
        feather(reference.mask, width * reference.resolution)
        for width in (edge, BEARD_LIMITS.edge_face_widths)
    )
    return np.asarray(np.maximum(wide, beards * narrow), np.float32)


def _painted_eyes(person: TrackedPerson, donor: Donor, rgb: F32) -> tuple[Step, ...]:
    """What paints a donor's eyeballs into their texture (n, 3), looking where the person looks."""
    reference = person.identity.reference
    theirs = Irises.at_rest(reference, donor.at_rest, rgb).in_human_range()
    gaze = Gaze(person.irises, person.at_rest)
    return gaze.follow, Eyeballs(reference, theirs, donor.at_rest, rgb).paint


def _over_beard(own: F32, look: Look, reference: ReferenceFrame) -> F64:
    """(81, 2) grid pixels by which the face is drawn beyond the jaw line where the person's beard (h, w) reaches it."""
    x, y = np.minimum(np.round(reference.points).astype(int), np.array(own.shape[::-1]) - 1).T
    jaw = max(BEARD_LIMITS.beyond_jaw_face_widths - look.jaw, 0.0)
    beyond: F64 = outward(reference, jaw, 0.0) * own[y, x][:, None]
    return beyond


def _glasses(donor: Donor, transfer: ShapeTransfer, reference: ReferenceFrame) -> tuple[Step, ...]:
    """What draws a donor's glasses, if they wear any."""
    rest = donor.enrolled.rest_frame
    worn = WornGlasses.of(rest)
    if worn is None:
        return ()
    return (DonorGlasses(GlassesOnHead.of(worn, rest.shape, transfer.solid), reference).draw,)


def _paper(person: TrackedPerson, donor: Donor, look: Look) -> Plan:
    """The papers: the donor's own space and a share beyond it, one similarity of colours, over all that is in front."""
    reference, identity, own = person.identity.reference, donor.enrolled, person.identity.appearance
    gate = 1.0 if look.exact else DEFAULT_GATE
    extrapolator = Extrapolator(own, identity.appearance, look.alpha, anchored=not look.exact, gate=gate)
    texture = PlainTexture(extrapolator, person.estimator)
    mask, relief = shown_mask(person.mask, reference), Relief.flat(reference)
    own_eyes = EYES if look.eyes == "source" else ()
    own_mouth = (INNER_LIPS,) if look.mouth == "source" else ()
    irises = _iris_change(person, donor, identity.appearance.neutral_texture) if own_eyes else None
    tint = partial(IrisTint, irises) if irises else None
    place = RigidPlace(reference)
    light = PaperLight(reference, person.texels, mask, "least-squares" if look.exact else "symmetric")
    enlargement = Enlargement(identity.detail, cv2.INTER_LINEAR)
    apertures = Apertures(reference, person.at_rest, (*own_eyes, *own_mouth), (), tint, ())
    alpha = feather(mask, NARROW_FEATHER * reference.resolution)
    blend = Blend(relief, alpha, look.renderer)
    looks = (Gaze(irises.source, person.at_rest).follow,) if irises else ()
    seeing = texture.look, texture.measure, texture.synthesise
    placing = place.lay, *looks, light.measure, enlargement.choose, blend.spread, blend.begin
    drawing = light.apply, blend.scatter, enlargement.enlarge, apertures.draw, blend.composite, blend.write
    return Plan(look, person.identity, identity, texture, blend, None, seeing, placing, drawing)


def _puppet(person: TrackedPerson, donor: Donor, look: Look) -> Plan:
    """The donor's face on their own head in a still, whose light is measured once."""
    reference, identity = person.identity.reference, donor.enrolled
    own = TrackedPerson.of(identity, reference.resolution)
    extrapolator = Extrapolator(person.identity.appearance, identity.appearance, look.alpha)
    texture = PlainTexture(extrapolator, person.estimator)
    mask, relief = shown_mask(own.mask, reference), Relief.shipped(reference)
    light: QuotientLight | PaperLight = QuotientLight(reference, own.texels, mask, (own.texture, own.texture))
    if look.exact:
        light = PaperLight(reference, own.texels, mask)
    surface, enlargement = Finish(reference, mask), Enlargement(identity.detail, cv2.INTER_CUBIC)
    alpha = feather(mask, FEATHER * reference.resolution)
    blend = Blend(relief, alpha, look.renderer)
    placing = light.measure, enlargement.choose, blend.spread, blend.begin
    drawing = (
        light.apply, blend.scatter, surface.sharpen, enlargement.enlarge, surface.look, blend.composite,
        surface.compare, blend.write,
    )  # fmt: skip
    return Plan(look, person.identity, identity, texture, blend, None, (), placing, drawing)


_PLANS: dict[Kind, Callable[[TrackedPerson, Donor, Look], Plan]] = {
    "swap": _swap, "live": _swap, "disguise": partial(_swap, shows_skin=False), "paper": _paper, "puppet": _puppet,
}  # fmt: skip
