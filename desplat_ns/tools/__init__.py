"""What no run needs: captures made of photos, downloads, exports, pages, studies and commands.

Nothing outside of this room imports it."""
