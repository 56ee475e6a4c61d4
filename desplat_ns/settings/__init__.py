"""What settings may be: `options` checks numbers, `effects` are the switches of the effects."""
