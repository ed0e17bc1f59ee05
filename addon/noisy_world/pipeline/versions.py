# SPDX-License-Identifier: GPL-3.0-or-later
"""The versions of what renders a plan."""

from ..core.planning.plan import Plan


def versions_of(plan: Plan) -> dict[str, str]:
    """Return the versions of Blender and of what else renders the plan."""
    if not plan.needs_blender:
        return {}
    if not plan.renders_anything:
        from ..blender.session import blender_version

        return blender_version()
    from ..blender.session import renderer_versions

    return renderer_versions(plan.preset.spec.render.engine, plan.preset.spec.render.device)
