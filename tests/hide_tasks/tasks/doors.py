"""Doors, drawers and lids set by hand."""


def open_to(world, part, opening):
    """Open a door, a drawer or a lid so far, and let a step pass."""
    body = next(asset for asset in vars(part).values() if hasattr(asset, "body")).body
    world.scene.client.resetJointState(body.id, part.link - 1, opening)
    world.step()
