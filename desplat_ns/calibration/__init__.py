"""What training costs on this machine: steps of generated scenes that cost what trained ones do.

May import `model`, `gaussians`, `backend` and `effects`.
"""
