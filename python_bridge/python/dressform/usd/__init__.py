"""Reading characters and outfits from USD stages, and writing dressed ones."""

from .plugin import register

register()
