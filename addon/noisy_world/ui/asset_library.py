# SPDX-License-Identifier: GPL-3.0-or-later
"""The node groups as one of Blender's asset libraries: a button adds or removes it; disabling the add-on removes it."""

from pathlib import Path
from typing import Any

import bpy

from ..core.utf8_names import utf8_name
from .operators import CANCELLED, DONE

PACKAGE = (__package__ or "").rpartition(".")[0]  # bl_ext.<repository>.noisy_world, or noisy_world in a checkout
ASSETS = Path(__file__).resolve().parents[1] / "assets"
NAME = "Noisy World"


def is_built() -> bool:
    """Tell whether there is a library; a checkout has none before it is built."""
    return any(ASSETS.glob("*.blend"))


def libraries() -> bpy.types.AssetLibraryCollection:
    """Return the asset libraries in the preferences."""
    return bpy.context.preferences.filepaths.asset_libraries


def entry() -> bpy.types.UserAssetLibrary | None:
    """Return the library's entry in the preferences, also if a user added or renamed it."""
    return next((item for item in libraries() if item.path and Path(item.path).resolve() == ASSETS), None)


def _kept() -> Any | None:
    """Return the add-on's preferences; None if it is registered from a checkout."""
    found = bpy.context.preferences.addons.get(PACKAGE)
    return None if found is None else found.preferences


class NoisyWorldAddAssetLibrary(bpy.types.Operator):
    """Offer the perturbations' node groups in the compositor's Add menu and asset shelf"""

    bl_idname = "noisy_world.add_asset_library"
    bl_label = "Add Node Groups to Asset Libraries"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, _: bpy.types.Context) -> bool:
        """Tell whether there is something to add."""
        if not is_built():
            cls.poll_message_set("There is no asset library here: build it with make assets")
            return False
        if entry() is not None:
            cls.poll_message_set("The node groups are among the asset libraries already")
            return False
        return True

    def execute(self, _: bpy.types.Context) -> set[str]:
        """Add them."""
        # Blender's own operator reloads shelves and menus; the functions of the collection do not.
        bpy.ops.preferences.asset_library_add(directory=utf8_name(ASSETS))
        made = entry()
        if made is None:
            self.report({"ERROR"}, f"{ASSETS}: Blender did not take the asset library")
            return CANCELLED
        made.name = NAME
        self.report({"INFO"}, "The node groups are in the compositor's Add menu and asset shelf")
        return DONE


class NoisyWorldRemoveAssetLibrary(bpy.types.Operator):
    """Take the perturbations' node groups out of the asset libraries; groups in use stay"""

    bl_idname = "noisy_world.remove_asset_library"
    bl_label = "Remove Node Groups from Asset Libraries"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, _: bpy.types.Context) -> bool:
        """Tell whether there is something to remove."""
        if entry() is None:
            cls.poll_message_set("The node groups are not among the asset libraries")
            return False
        return True

    def execute(self, _: bpy.types.Context) -> set[str]:
        """Remove them."""
        while (found := entry()) is not None:
            bpy.ops.preferences.asset_library_remove(index=list(libraries()).index(found))
        return DONE


class NoisyWorldPreferences(bpy.types.AddonPreferences):
    """What holds for all files"""

    bl_idname = PACKAGE

    returns: bpy.props.BoolProperty(  # pyright: ignore[reportInvalidTypeForm]  Blender reads annotations
        name="Asset Library Returns",
        description="Whether the asset library went with the add-on, and comes back with it",
        options={"HIDDEN"},
    )

    def draw(self, _: bpy.types.Context) -> None:
        """Draw the button."""
        draw_button(self.layout)


def draw_button(layout: bpy.types.UILayout) -> None:
    """Draw the button that adds the library or, where it is there, removes it."""
    kind: Any = NoisyWorldAddAssetLibrary if entry() is None else NoisyWorldRemoveAssetLibrary
    layout.operator(kind.bl_idname, icon="ASSET_MANAGER")


def draw_library(layout: bpy.types.UILayout, _: bpy.types.Context) -> None:
    """Draw the button in the tab, until the library is added."""
    if is_built() and entry() is None:
        layout.operator(NoisyWorldAddAssetLibrary.bl_idname, text="Add Groups to Asset Browser", icon="ASSET_MANAGER")


LIBRARY_CLASSES = (NoisyWorldAddAssetLibrary, NoisyWorldRemoveAssetLibrary, NoisyWorldPreferences)
_register_classes, _unregister_classes = bpy.utils.register_classes_factory(LIBRARY_CLASSES)


def register_asset_library() -> None:
    """Register the buttons, and add the library again if it was removed with the add-on, as in an update."""
    _register_classes()
    if (kept := _kept()) is not None and kept.returns:
        kept.returns = False
        if entry() is None:
            libraries().new(name=NAME, directory=utf8_name(ASSETS))


def unregister_asset_library() -> None:
    """Unregister everything, and remove the library that was added, since its folder may be deleted next."""
    found = entry()
    if found is not None and found.name.startswith(NAME):  # not an entry that a user added by hand
        if (kept := _kept()) is not None:
            kept.returns = True
        libraries().remove(found)
    _unregister_classes()
