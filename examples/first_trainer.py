import numpy as np, sparring

members, rng, weights = 128, np.random.default_rng(), np.zeros((4, 2))
settings = {"tasks": ["kessler/survival"], "placement": False}
with sparring.Curriculum(url="http://127.0.0.1:8700", settings=settings) as curriculum:
    envs = sparring.make_vec(num_envs=members, curriculum=curriculum)
    tracks, _ = envs.reset()
    for version in range(40):
        curriculum.policy_version = version
        noise, returns = rng.normal(size=(members, 4, 2)), np.zeros(members)
        for step in range(51):                                      # an episode of 50 steps, and its reset
            debris = tracks[:, :, 16:].reshape(members, 3, 8, 7)    # 3 satellites, 8 pieces of debris for each
            danger = debris[..., :1] * np.maximum(0, 1 - 2 * debris[..., 5:6])    # 1: collision, 0: misses by 5 LU
            threats = (danger * debris[..., 1:5]).sum(axis=2)       # relative position and velocity of the debris
            burns = np.einsum("nsf,nfa->nsa", threats, weights + 0.3 * noise).clip(-1, 1)
            tracks, rewards, *_ = envs.step(burns.astype(np.float32))
            returns += rewards
        weights += np.einsum("n,nfa->fa", returns.argsort().argsort() / members - 0.5, noise) / members
        if version % 5 == 4:
            metrics = curriculum.metrics()
            print("update {}: level {kessler/survival/level:.0f}, skill {kessler/survival/skill:.2f}".format(version + 1, **metrics))
