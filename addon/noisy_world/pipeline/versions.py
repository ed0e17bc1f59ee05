# SPDX-License-Identifier: GPL-3.0-or-later
"""Versions of the renderers and of the compositor that a plan uses."""

from ..core.planning.plan import Plan


def versions_of(plan: Plan) -> dict[str, str]:
    """Return the versions of Blender and of what else renders the plan.

    Raises MissingDependencyError where that cannot run here.
    """
    device, versions = plan.preset.spec.render.device, dict[str, str]()
    for engine in plan.engines:
        if engine == "embree":
            from ..rays.embree import embree_version

            versions |= embree_version()
        else:
            from ..blender.session import renderer_versions

            versions |= renderer_versions(engine, device if engine == "cycles" else "cpu")
    if plan.composites or any(scene.source.capabilities.imported for scene in plan.scenes):
        from ..blender.session import blender_version

        versions |= blender_version()
    return versions
