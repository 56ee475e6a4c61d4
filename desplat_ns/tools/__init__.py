"""What no run needs, and nothing outside imports: captures of photos, exports, pages, studies."""
