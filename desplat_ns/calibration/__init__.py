"""What training costs on this machine, and what a budget of time buys there.

Steps of generated scenes are timed that cost what trained ones do. May import `model`, `training`,
`gaussians`, `backend`, `settings`, `console`, `cores` and
`errors`.
"""
