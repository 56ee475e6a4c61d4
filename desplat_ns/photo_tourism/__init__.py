"""What tourists' photos need besides: appearance, background, their data and their protocol."""
