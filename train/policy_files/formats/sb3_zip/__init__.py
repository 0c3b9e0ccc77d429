"""Read a policy that stable-baselines3 (SB3) saved, without executing anything stored in it.

`read_sb3_zip` opens the zip, takes the weights with torch's restricted reader and the architecture
from the readable half of its JSON.
"""
