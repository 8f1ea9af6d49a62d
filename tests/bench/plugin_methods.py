"""Methods that keep the contract, and one for each way to break it; written into a package by `installed`."""

import json
import os
import pickle

import numpy as np

from algorithms.method import Method, Policy


class Fixed(Policy):
    def __init__(self, action):
        self.action = action

    def act(self, observations):
        return np.tile(self.action, (len(observations), 1))

    def save(self, folder):
        (folder / "action.json").write_text(json.dumps(list(self.action)))


class Learner(Method):
    """TD(0) with linear values; its action depends on all that it learnt."""

    policy = Fixed

    def train(self, task):
        env = task.make_env(16)
        rng = np.random.default_rng(self.seed(task))
        w = np.zeros(47)
        x, _ = env.reset()
        while env.decisions < self.limit(env):
            self.look(x)
            following, reward, terminated, truncated, info = env.step(rng.uniform([-3.5, -2], [3.5, 2], (16, 2)))
            done = (terminated | truncated)[:, None]
            after = np.where(done, info.get("final_obs", following), following)
            w += 1e-4 * (reward + 0.9 * self.follows(x, after, following, terminated, truncated, w) - x @ w) @ x
            w += self.heed(info)
            x = following
        return self.policy((0.0, float(np.tanh(w.sum()))))

    def seed(self, task):
        return task.stream("policy")

    def limit(self, env):
        return env.decision_limit

    def look(self, x):
        pass

    def heed(self, info):
        return 0.0

    def follows(self, x, after, following, terminated, truncated, w):
        return np.where(terminated, 0.0, after @ w)

    def load_policy(self, folder, task):
        return self.policy(json.loads((folder / "action.json").read_text()))


class Heeding(Learner):
    bounds_cost = True

    def heed(self, info):
        return 1e-3 * info["cost"].sum()


class Heedless(Learner):
    bounds_cost = True


class Terminating(Learner):
    def follows(self, x, after, following, terminated, truncated, w):
        return np.where(terminated | truncated, 0.0, after @ w)


class Resetting(Learner):
    def follows(self, x, after, following, terminated, truncated, w):
        return np.where(terminated, 0.0, following @ w)


class Evolving(Learner):
    bootstraps = False

    def follows(self, x, after, following, terminated, truncated, w):
        return 0.0


class Greedy(Learner):
    def limit(self, env):
        return env.decision_limit + 1


class Idle(Learner):
    def limit(self, env):
        return env.decision_limit - 1


class Unseeded(Learner):
    def seed(self, task):
        return int.from_bytes(os.urandom(8), "big")


class Writing(Learner):
    def look(self, x):
        x *= 0.5


class Tripping(Learner):
    def look(self, x):
        raise RuntimeError("tripped")


class WritingPolicy(Fixed):
    def act(self, observations):
        observations[:, 2] = 0.0
        return super().act(observations)


class WritingInUse(Learner):
    policy = WritingPolicy


class NaNPolicy(Fixed):
    def act(self, observations):
        return np.full((len(observations), 2), np.nan)


class NaN(Learner):
    policy = NaNPolicy


class WidePolicy(Fixed):
    def act(self, observations):
        return np.tile([0.0, 9.0], (len(observations), 1))


class Wide(Learner):
    policy = WidePolicy


class FlatPolicy(Fixed):
    def act(self, observations):
        return np.zeros(2)


class Flat(Learner):
    policy = FlatPolicy


class PicklingPolicy(Fixed):
    def save(self, folder):
        (folder / "action.pkl").write_bytes(pickle.dumps(self.action))


class Pickling(Learner):
    policy = PicklingPolicy


class Forgetful(Learner):
    def load_policy(self, folder, task):
        return Fixed((1.0, 1.0))


class Guard:
    def begin(self, seed):
        pass

    def observe(self, observations):
        pass

    def filter(self, world, targets, accelerations):
        return targets, np.minimum(accelerations, 0.5), accelerations > 0.5, None


class WritingGuard(Guard):
    def filter(self, world, targets, accelerations):
        accelerations[:] = 0.0
        return targets, accelerations, accelerations > 0.5, None


class Scripted(Method):
    trains = False
    guard = Guard

    def train(self, task):
        policy = Fixed((0.0, 1.0))
        policy.shield = self.guard()
        return policy

    def load_policy(self, folder, task):
        return self.train(task)


class WritingShield(Scripted):
    guard = WritingGuard
