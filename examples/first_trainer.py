import numpy as np, sparring

count, rng, weights = 128, np.random.default_rng(), np.zeros((4, 2))
settings = {"tasks": ["kessler/survival"], "strategy": "ladder", "placement": False}
with sparring.Curriculum(url="http://127.0.0.1:8700", settings=settings) as curriculum:
    envs = sparring.make_vec(num_envs=count, curriculum=curriculum)
    tracks, _ = envs.reset()
    for version in range(40):
        curriculum.policy_version = version
        noise, returns = rng.normal(size=(count, 4, 2)), np.zeros(count)
        for step in range(51):                                  # 50 steps, and the reset
            debris = tracks[:, :, 16:].reshape(count, 3, 8, 7)  # 3 satellites, 8 debris each
            danger = debris[..., :1] * np.maximum(0, 1 - 2 * debris[..., 5:6])  # 0 for far misses
            threats = (danger * debris[..., 1:5]).sum(axis=2)   # relative position and velocity
            burns = np.einsum("nsf,nfa->nsa", threats, weights + 0.3 * noise).clip(-1, 1)
            tracks, rewards, *_ = envs.step(burns.astype(np.float32))
            returns += rewards
        weights += np.einsum("n,nfa->fa", returns.argsort().argsort() / count - 0.5, noise) / count
        if version % 5 == 4:
            row = "update {} level {kessler/survival/level:.0f} skill {kessler/survival/skill:.2f}"
            print(row.format(version + 1, **curriculum.metrics()))
