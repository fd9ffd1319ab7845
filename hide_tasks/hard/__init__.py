"""Suite `hide-hard`: HIDE's tasks whose pictures tell what is hidden, with that leak closed."""

from hide_tasks.assets.colors import COLORS

# Nineteen, a prime: variations of three axes are dealt along one diagonal, where lengths that
# share a factor would let a told colour tell a hidden number. Silver is the dispenser's own.
TOLD_COLORS = tuple(name for name in COLORS if name != "silver")
