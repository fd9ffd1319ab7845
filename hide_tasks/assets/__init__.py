"""What things are (parts, sizes, colours, joints) and what can be read of them.

Descriptions are numpy alone; `hide_tasks.bullet` gives them bodies.
"""

from hide_tasks.assets.asset import Asset, Body, Joint, Link, Shape
from hide_tasks.assets.block import Block
from hide_tasks.assets.button import Button
from hide_tasks.assets.chest import Chest, Drawer
from hide_tasks.assets.colors import CLEAR_COLORS, COLORS
from hide_tasks.assets.region import Region

__all__ = [
    "CLEAR_COLORS",
    "COLORS",
    "Asset",
    "Block",
    "Body",
    "Button",
    "Chest",
    "Drawer",
    "Joint",
    "Link",
    "Region",
    "Shape",
]
