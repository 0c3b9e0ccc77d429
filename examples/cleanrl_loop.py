"""A CleanRL-style PPO on `gym.make_vec`: python examples/cleanrl_loop.py --total-steps 1000000."""

from argparse import ArgumentParser

import gymnasium as gym
import torch
from torch.distributions import Normal
from torch.nn import Linear, Parameter, Sequential, Tanh

parser = ArgumentParser(description="PPO from top to bottom on 64 pendulums.")
parser.add_argument("--total-steps", type=int, default=1_000_000)
home = {"integrator": "rk4", "dt": 0.05, "control_period": 0.05, "start": "hanging"}
envs = gym.make_vec("integ_gym:IntegPendulum-v0", 64, **home, autoreset_mode="Disabled")
actor, critic = (Sequential(Linear(3, 256), Tanh(), Linear(256, 1)) for _ in range(2))
spread = Parameter(torch.zeros(1))
adam = torch.optim.Adam([*actor.parameters(), *critic.parameters(), spread], lr=1e-3)
for episode in range(max(1, parser.parse_args().total_steps // (64 * 200))):
    seen, acts, paid = [torch.as_tensor(envs.reset(seed=episode)[0])], [], []
    for _ in range(200):  # decisions in an episode, which ends by the clock alone
        acts.append(Normal(actor(seen[-1]), spread.exp()).sample())
        after, reward, *_ = envs.step(acts[-1].numpy())
        seen.append(torch.as_tensor(after))
        paid.append(torch.as_tensor(reward[:, None], dtype=torch.float32) / 10.0)
    values, better = critic(torch.stack(seen)).detach(), [torch.zeros(64, 1)]
    for t in reversed(range(200)):  # generalized advantages, for a discount of 0.95
        better.append(paid[t] + 0.95 * values[t + 1] - values[t] + 0.95**2 * better[-1])
    x, a, good = torch.stack(seen[:-1]), torch.stack(acts), torch.stack(better[:0:-1])
    old = Normal(actor(x), spread.exp()).log_prob(a).detach()
    rows = [part.flatten(0, 1) for part in (x, a, old, good, good + values[:-1])]
    for chosen in [p for _ in range(10) for p in torch.randperm(64 * 200).split(800)]:
        x, a, old, good, goal = (part[chosen] for part in rows)
        ratio = (Normal(actor(x), spread.exp()).log_prob(a) - old).exp()
        good = (good - good.mean()) / good.std()
        gain = torch.min(ratio * good, ratio.clamp(0.8, 1.2) * good).mean()
        loss = 0.5 * (critic(x) - goal).square().mean() - gain
        adam.zero_grad()
        loss.backward()
        adam.step()
    print(f"{12_800 * (episode + 1):>9} decisions: return {10.0 * sum(paid).mean():.0f}")
