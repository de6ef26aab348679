"""How strong the effects are. A recipe says how often each is applied; these limits are properties of the effects."""

from __future__ import annotations

GAMMA = (0.6, 1.7)  # log-uniform; beyond it shadows or lights lose all structure in 8 bits
MOTION_BLUR_PX = (
    3.0,
    14.0,
)  # below 3 px nothing is seen; 14 px is a target moving a ninth of an exemplar in an exposure
BLUR_SIGMA_PX = (0.7, 2.0)  # defocus; a 127 px exemplar still shows its parts at 2 px
LOW_RESOLUTION = (0.25, 0.7)  # share of the pixels' pitch that is left; a far target fills a crop with 16 px of its own
EXEMPLAR_LOW_RESOLUTION = (0.2, 0.6)  # more than in the search crop: targets are marked far away and come nearer
NOISE_SIGMA = (3.0, 14.0)  # grey levels; small sensors at dusk reach 14
FOG = (0.2, 0.5)  # share of the light that comes from the haze
FOG_LEVEL = (180.0, 220.0)  # grey level of the haze: bright, not saturated
JPEG_QUALITY = (12.0, 45.0)  # blocks are visible below 50; weak radio links go down to about 12
OCCLUSION = (0.2, 0.6)  # share of the box's width and of its height: at most 36 % is hidden, so the box stays knowable
OCCLUSION_MIN_PX = 4  # a smaller patch is noise
OCCLUSION_OUT = 0.3  # share of the patch's side that may reach beyond the box
LOOKALIKE_LOG_SCALE = 0.25  # an identical copy would be a contradiction: no one could tell which of the two is meant
LOOKALIKE_GAIN = (0.8, 1.25)
LOOKALIKE_CAST = 12.0  # standard deviation per channel, grey levels: another paint, not a tint that gives it away
LOOKALIKE_CONTEXT = 1.1  # the copied part is a little larger than the box, so that the soft edge is not in the target
LOOKALIKE_FEATHER = 0.2  # share of the half side over which the copy fades out
LOOKALIKE_OVERLAP = 0.05  # share of the target's box that the copy may cover
LOOKALIKE_TRIES = 4  # places drawn; the first that is free is taken, none means no copy (the target fills the crop)
