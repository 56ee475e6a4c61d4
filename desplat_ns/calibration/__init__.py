"""What training costs on this machine, and what a budget of time buys there.

Steps of generated scenes are timed that cost what trained ones do; the moments at which a step
would wait for a GPU are counted without one. May import `model`, `training`,
`gaussians`, `backend`, `settings`, `console` and `errors`.
"""
