# SPDX-License-Identifier: GPL-3.0-or-later
"""Tooltips of parameters: what one sees when the value grows. Formulas are in docs/perturbations.md."""

_AIR = {
    "air": "Whether its light comes from the scene, is a gray, or is the color below",
    "air_red": "Higher: redder light, where Air is Color",
    "air_green": "Higher: greener light, where Air is Color",
    "air_blue": "Higher: bluer light, where Air is Color",
    "leave_sky": "On: the sky keeps its colors",
}
_FALLING = {
    "size": "Higher: every particle is larger",
    "tint": "Higher: particles take more of the color of the scene",
    "fall": "Higher: they fall faster, in longer streaks",
    "aperture_mm": "Higher: particles out of focus become larger, fainter disks",
    "focus_m": "How far away particles are sharp; nearer and further ones are blurred",
    "least_mrad": "Higher: fewer small particles are drawn, and the veil in the distance gets denser instead",
    "reach_m": "Lower: less of what is far is drawn, and the veil takes its place",
    "void_m": "Higher: where nothing is, the veil gets denser",
    "view_deg": "Higher: a wider view, so particles are smaller in it",
    "frame_rate_hz": "Lower: with the pattern Drift, particles move further from frame to frame",
    **_AIR,
}

_DEVICE = {
    "device": "Whose values are taken where a field is below 0",
    "noise": "Higher: everything random is stronger; 0 leaves rounding and holes",
    "focal_px": "Higher: the sensor's own image has more pixels to a degree, so depth gets better",
    "baseline_m": "Higher: depth gets better, and the shadows beside things wider",
    "step_px": "Higher: far depth is in larger steps",
    "shift_px": "Higher: edges get more ragged",
    "min_m": "Higher: more of what is near has no depth",
    "max_m": "Lower: more of what is far has no depth",
}

SEEN: dict[str, dict[str, str]] = {
    "axial_noise": _DEVICE
    | {
        "from_m": "Higher: noise begins to grow further away",
        "offset_m": "Higher: everything gets rougher by the same",
        "linear": "Higher: what is far gets rougher",
        "quadratic_per_m": "Higher: what is far gets much rougher",
        "steep": "Higher: surfaces seen at a glancing angle get rougher",
        "lateral_px": "Higher: edges get more ragged",
        "lateral_steep_px": "Higher: edges of surfaces seen at an angle get more ragged",
    },
    "lidar": _DEVICE
    | {
        "rows": "Higher: more rows of points",
        "below_deg": "Higher: rows reach further down",
        "above_deg": "Higher: rows reach further up",
        "azimuth_step_deg": "Higher: fewer points in a row",
        "sigma_m": "Higher: surfaces get rougher, at any distance",
        "step_m": "Higher: ranges are in larger steps",
    },
    "redwood": _DEVICE
    | {
        "product_px_m": "Higher: depth gets better",
        "sigma_px": "Higher: far surfaces get rougher",
    },
    "stereo": _DEVICE
    | {
        "sigma_px": "Higher: far surfaces get rougher",
        "search_px": "Lower: more of what is near has no depth",
        "least_contrast": "Higher: more plain walls have no depth; 0: none is lost",
        "pattern": "Higher: plain walls have depth further away",
        "speckle": "Higher: the borders of holes get more ragged",
    },
    "structured_light": _DEVICE
    | {
        "sigma_px": "Higher: steps of depth get more ragged",
        "window_px": "Higher: larger thin things have no depth",
        "least_share": "Higher: corners and thin things lose more",
    },
    "time_of_flight": _DEVICE
    | {
        "frequency_mhz": "Higher: depth gets better, and begins again at 0 sooner",
        "unambiguous_m": "Lower: what is far comes back as near",
        "electrons": "Higher: less noise, and what is near gets too bright",
        "ambient_electrons": "Higher: more noise, as in sunlight",
        "read_electrons": "Higher: more noise where it is dark or far",
        "contrast": "Higher: less noise",
        "least_electrons": "Higher: more of what is dark or far has no depth",
        "most_electrons": "Lower: more of what is bright and near has no depth",
        "spread": "Higher: more pixels hang in the air between near and far",
        "jump_m": "Lower: wider gaps beside edges; 0: none",
    },
    "brightness": {"offset": "Higher: the whole picture gets lighter, until bright places are white"},
    "contrast": {"factor": "Lower: the picture gets flatter, toward one gray; above 1 it gets harsher"},
    "defocus_blur": {
        "radius_px": "Higher: everything is further out of focus; points grow to larger disks",
        "alias_sigma_px": "Higher: the disks' rims get softer",
    },
    "defocus_depth": {
        "focus_m": "How far away the sharp plane is; what is nearer or farther is blurred",
        "f_number": "Lower: a wider aperture, so less is sharp before and behind the focus",
        "focal_length_mm": "Higher: less is sharp before and behind the focus",
        "sensor_width_mm": "Higher: the same lens blurs fewer pixels",
        "max_radius_px": "Higher: what is far out of focus may blur more, and takes longer",
    },
    "depth_edge_erosion": {
        "rate": "Higher: more blocks are missing along the edges of things",
        "erase_edges": "On: the edges of all things are missing too",
    },
    "depth_gaussian_noise": {
        "scale": "Higher: surfaces get rougher, far ones more than near ones",
        "bias": "On: the whole frame moves away as well",
    },
    "depth_random_missing": {"missing_percent": "Higher: more and larger holes without depth"},
    "depth_range_clipping": {
        "min_m": "Higher: more of what is near has no depth",
        "max_m": "Lower: more of what is far has no depth",
    },
    "desync": {
        "offset": "Further from 0: depth shows a moment further from the color's; its sign says before or after",
        "mode": "Whether all frames are off by the same, or each by a draw of its own",
        "edge": "What happens where depth would come from before the first frame or after the last",
    },
    "faster_motion": {"factor": "Higher: the camera moves further from frame to frame, and there are fewer frames"},
    "fog": {
        "thickness": "Higher: the haze gets denser, and contrast goes",
        "smoothness": "Higher: softer, larger clouds; lower: ragged ones",
        "uniform": "On: the same gray everywhere instead of clouds",
        "flow_px": "Higher: with the pattern Drift, the clouds move faster",
    },
    "fog_depth": {
        "visibility_m": "Lower: the fog gets denser, and hides what is nearer",
        "airlight": "Higher: the fog gets lighter; 0 is smoke, 1 is white",
        "falloff_m": "Above 0 the fog lies on the ground: lower, and roofs and sky come out of it",
        "camera_height_m": "Higher: the camera stands more above low fog, and sees more",
        "unevenness": "Higher: the fog comes in clumps, with clearer air between",
        "clump_m": "Higher: larger clumps",
        "wind_m_s": "Further from 0: with the pattern Drift, clumps move faster to the right, or to the left below 0",
        "glow": "Higher: lamps glow more in the fog",
        "glow_width_deg": "Higher: wider and softer glows",
        "view_deg": "Higher: as through a wider lens; a known camera decides it",
        "frame_rate_hz": "Lower: with the pattern Drift, more time passes from frame to frame",
        "outdoors": "On: severities are those of streets, where one sees further than in rooms",
        **_AIR,
    },
    "camera_motion_blur": {
        "shutter_ms": "Higher: a moving camera smears the picture more",
        "stamp": "Which moment of the exposure has the time stamp and the pose of the frame",
        "ramp": "Higher: the shutter opens and closes more slowly, and streaks fade out at their ends",
        "depth": "Which moment of the exposure depth shows; it stays sharp",
        "moments_per_px": "Higher: smoother streaks, and it takes longer",
        "most_moments": "Higher: long streaks are smooth too, and take longer",
    },
    "rolling_shutter": {
        "readout_ms": "Higher: a moving camera skews and bends the picture more",
        "direction": "Where reading goes; what moves across that direction leans",
        "stamp": "Which moment of the readout has the time stamp and the pose of the frame",
        "depth": "Whether lines of depth are read one after another too, or all at once",
    },
    "haze": {
        "visibility_m": "Lower: the haze gets denser, and hides what is nearer",
        "angstrom": "Higher: the distance gets bluer, and lamps in it redder; 0 is gray, as fog",
        "airlight": "Higher: the haze gets lighter; 0 is smoke, 1 is white",
        "blueness": "Higher: the haze itself gets bluer",
        "void_m": "Lower: more of the sky is seen through the haze",
        **_AIR,
    },
    "frost": {
        "intensity": "Lower: the picture behind the ice gets darker",
        "influence": "Higher: the ice on the lens gets brighter",
        "creep_px": "Higher: with the pattern Drift, the ice moves faster",
    },
    "lens_frost": {
        "coverage": "Higher: ferns of ice reach further from the border towards the middle",
        "opacity": "Higher: the ice gets denser, and hides what is behind it",
        "brightness": "Higher: the ice gets lighter",
        "tint": "Higher: the ice has the colors of what is around it; 0 is white ice",
        "refraction_px": "Higher: crystals displace what is behind them further",
        "glint": "Higher: brighter glints on the crystals' edges",
        "growth_per_s": "Higher: with the pattern Drift, ice grows faster; below 0 it thaws",
        "frame_rate_hz": "Higher: with the pattern Drift, ice grows less from frame to frame",
    },
    "snow_depth": {
        "rate_mm_h": "Higher: more and larger flakes, and what is far goes white",
        "brightness": "Higher: flakes and the white in the distance get lighter",
        "wind_m_s": "Further from 0: flakes fly further to the right, or to the left below 0",
        "gusts_m_s": "Higher: flakes go their own ways, and no two streaks lie alike",
        "shutter_ms": "Higher: flakes become longer and fainter streaks",
        **_FALLING,
    },
    "rain_depth": {
        "rate_mm_h": "Higher: more and larger drops, and what is far goes gray",
        "brightness": "Higher: streaks and the gray in the distance get lighter",
        "wind_m_s": "Further from 0: streaks lean further to the right, or to the left below 0",
        "gusts_m_s": "Higher: drops go their own ways, and no two streaks lie alike",
        "shutter_ms": "Higher: streaks get longer and fainter",
        **_FALLING,
    },
    "gaussian_blur": {"sigma_px": "Higher: the picture gets softer, and detail goes"},
    "gaussian_noise": {"std": "Higher: more color grain, everywhere alike"},
    "glass_blur": {
        "sigma_px": "Higher: softer before and after pixels change places",
        "max_delta_px": "Higher: pixels change places over a longer way, as behind coarser glass",
        "iterations": "Higher: more pixels change places, and it takes longer",
    },
    "impulse_noise": {"amount": "Higher: more pixels are pure black, white or a pure color"},
    "jpeg_compression": {"quality": "Lower: coarser blocks of 8 pixels, and blurrier colors"},
    "lens_dirt": {
        "dust": "Higher: darker specks of dust",
        "smudges": "Higher: thicker grease; bright light spreads over it",
        "scratches": "Higher: deeper scratches, which light up near lamps",
        "size": "Higher: all dirt is larger",
        "reach_px": "Higher: lamps light up dirt further away from them",
        "streaks": "Higher: lamps draw streaks instead of halos",
        "wiped_deg": "Turns the streaks, which run across the direction of wiping",
        "glare": "Higher: dirt shines more than it takes away; 1 is as it is, 0 only takes away",
    },
    "lens_drops": {
        "coverage": "Higher: more drops on the glass",
        "size_px": "Higher: larger drops, and fewer",
        "spread": "Higher: drops differ more in size",
        "focus_px": "Higher: drops, and what they show, get softer; 0 is a lens that focuses on the glass",
        "contact_deg": "Higher: steeper drops, which show more of the scene and have darker rims",
        "rim": "Higher: lighter rims; 0 is black",
        "glint": "Higher: a brighter highlight on each drop",
        "runs": "Higher: more drops run down",
        "run_px": "Higher: with the pattern Drift, drops run faster",
        "drying": "Higher: with the pattern Drift, drops dry and land more often",
        "view_deg": "Higher: a wider view, so a drop shows what is nearer to it in the picture",
    },
    "motion_blur": {
        "radius_px": "Higher: longer streaks",
        "sigma_px": "Higher: the streaks fade less toward their ends",
        "max_angle_deg": "Higher: the streaks' direction varies more from frame to frame",
        "angle_deg": "Turns the streaks",
    },
    "vibration": {
        "source": "What shakes the camera",
        "strength": "Higher: the camera shakes further",
        "translation_m": "Higher: it shakes further aside; below 0: as far as the source",
        "rotation_deg": "Higher: it turns further; below 0: as far as the source",
        "low_hz": "Higher: slow movements are left out; below 0: none",
        "high_hz": "Lower: fast movements are left out; below 0: none",
    },
    "drift": {
        "rotation_deg": "Higher: the camera leans further",
        "translation_m": "Higher: the camera shifts further",
        "period_s": "Higher: it drifts more slowly",
    },
    "jerk": {
        "per_minute": "Higher: more shocks",
        "duration_s": "Lower: shocks are shorter and harder",
        "translation_m": "Higher: a shock throws the camera further",
        "rotation_deg": "Higher: a shock turns the camera further",
    },
    "motion_deviation": {
        "rotation_deg": "Higher: the camera shakes more; at 20 degrees it looks elsewhere in each frame",
        "translation_m": "Higher: the camera jumps further off its path",
    },
    "pixelate": {"factor": "Lower: larger squares of one color"},
    "shot_noise": {"photons": "Lower: more grain, most of it in bright places; 0 is darkness"},
    "snow": {
        "mean": "Higher: more flakes",
        "std": "Higher: flakes differ more in brightness",
        "scale": "Higher: larger flakes, and fewer",
        "threshold": "Lower: more flakes",
        "blur_radius_px": "Higher: longer streaks behind the flakes",
        "blur_sigma_px": "Higher: the streaks fade less toward their ends",
        "blending_ratio": "Lower: the picture itself gets whiter, as in thick snowfall",
        "fall_px": "Higher: with the pattern Drift, the flakes fall faster",
    },
    "spatter": {
        "mean": "Higher: more of the lens is covered",
        "std": "Higher: drops differ more in size",
        "sigma_px": "Higher: larger, rounder drops",
        "threshold": "Lower: more drops",
        "scaling": "Higher: the drops cover the picture more",
        "complexity": "0 shows drops of water, 1 mud",
        "run_px": "Higher: with the pattern Drift, the drops run down faster",
    },
    "speckle_noise": {"std": "Higher: more grain in bright places; dark ones stay clean"},
}
"""By perturbation and parameter."""


def seen(perturbation: str, parameter: str) -> str:
    """Return the tooltip of a parameter; "" of those of other packages, which have only their meaning."""
    return SEEN.get(perturbation, {}).get(parameter, "")
