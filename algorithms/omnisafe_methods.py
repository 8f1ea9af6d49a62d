"""prototype"""
from __future__ import annotations
import math, tempfile, time, sys, json
import numpy as np, torch
from algorithms.omnisafe_env import known_to_omnisafe
from algorithms.omnisafe_library import *
from algorithms.omnisafe_library import omnisafe_module
from algorithms.omnisafe_settings import Settings

def build(algo, S, worlds, T, E, gamma, limit, seed, folder):
    om = omnisafe_module()
    defaults = omnisafe_module("omnisafe.utils.config").get_default_kwargs_yaml(algo, "", "on-policy").todict()
    want = {
     "train_cfgs": dict(device="cpu", torch_threads=1, vector_env_nums=worlds, parallel=1, total_steps=worlds*T*E),
     "algo_cfgs": dict(steps_per_epoch=worlds*T, update_iters=S.update_iters, batch_size=S.batch_size, target_kl=S.target_kl,
        reward_normalize=False, cost_normalize=False, obs_normalize=False, gamma=gamma, cost_gamma=gamma, lam=S.gae_lambda, lam_c=S.gae_lambda,
        cg_iters=S.cg_iters, fvp_sample_freq=S.fvp_sample_freq, cost_limit=limit, focops_lam=S.focops_lam, focops_eta=S.focops_eta),
     "logger_cfgs": dict(use_wandb=False, use_tensorboard=False, save_model_freq=10**9, log_dir=folder),
     "model_cfgs": dict(actor=dict(hidden_sizes=list(S.actor_hidden), activation=S.activation, lr=S.actor_lr),
                 critic=dict(hidden_sizes=list(S.critic_hidden), activation=S.activation, lr=S.critic_lr)),
     "lagrange_cfgs": dict(cost_limit=limit, lambda_lr=S.lambda_lr, lagrangian_upper_bound=S.lambda_max),
    }
    if defaults["model_cfgs"]["actor"]["lr"] is None: want["model_cfgs"]["actor"].pop("lr")
    cfg = {"seed": seed}
    for k, v in want.items():
        if k in defaults:
            cfg[k] = {a: b for a, b in v.items() if a in defaults[k]}
    return cfg
