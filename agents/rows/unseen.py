"""The rows that were made for unseen phantoms; none is part of the comparison."""

from usbench.agents.rows.entry import Entry

# Averages over a coarse grid.
GRID = {"features_extractor_class": "usbench.agents.value_based.grid_trunk:GridTrunk", "net_arch": []}

UNSEEN: dict[str, Entry] = {
    "double_dqn": Entry(
        title="double DQN, n-step returns, symmetries (van Hasselt 2016)",
        cls="usbench.agents.value_based.double_dqn:DoubleDQN",
        policy="MlpPolicy",
        policy_kwargs=GRID,
        n_envs=32,
        compared=False,
        hyperparameters={
            "learning_rate": 1e-3,
            "final_learning_rate": 5e-5,
            "buffer_size": 100_000,
            "learning_starts": 1_024,
            "batch_size": 128,
            "gamma": 0.9,
            "return_steps": 3,
            "train_freq": 32,
            "gradient_steps": 2,
            # An average of about the last hundred updates.
            "target_update_interval": 32,
            "tau": 0.02,
            "exploration_fraction": 0.2,
            "exploration_initial_eps": 1.0,
            "exploration_final_eps": 0.05,
            "max_grad_norm": 10.0,
            "max_shift_px": 0,
        },
        options={"greedy_shift_px": 0},
    ),
    "distilled": Entry(
        title="student of the best policy over beliefs; not ranked",
        cls="usbench.agents.taught.distilled:Distilled",
        policy="MlpPolicy",
        policy_kwargs=GRID,
        n_envs=32,
        compared=False,
        needs="teacher",
        hyperparameters={
            "learning_rate": 1e-3,
            "final_learning_rate": 5e-5,
            "buffer_size": 100_000,
            "learning_starts": 1_024,
            "batch_size": 128,
            "largest_cost": 0.5,
            "train_freq": 32,
            "gradient_steps": 4,
            # An average of about the last two hundred updates.
            "target_update_interval": 32,
            "tau": 0.02,
            # The share of the teacher's steps.
            "exploration_fraction": 0.1,
            "exploration_initial_eps": 1.0,
            "exploration_final_eps": 0.0,
            "max_grad_norm": 10.0,
            "max_shift_px": 0,
        },
        tasks={
            "exam-tracked": {
                # 32 new frames take as long as several updates.
                "gradient_steps": 8,
                # A student that turns to and fro, where its frames do not tell which way is right, fills its
                # memory with that; a step of the teacher ends it.
                "exploration_fraction": 0.3,
                "exploration_final_eps": 0.25,
            }
        },
    ),
    "ppo_asymmetric": Entry(
        title="PPO whose critic is told the state (Pinto et al. 2017)",
        cls="usbench.agents.asymmetric.ppo:AsymmetricPPO",
        policy="MlpPolicy",
        policy_kwargs=GRID | {"share_features_extractor": False},
        n_envs=16,
        compared=False,
        hyperparameters={
            "learning_rate": 6e-4,
            # 50 steps of each environment: they divide the 100 000 steps of the tracked tasks.
            "n_steps": 800,
            "batch_size": 200,
            "n_epochs": 6,
            "gamma": 0.9,
            "gae_lambda": 0.95,
            "clip_range": 0.2,
            "ent_coef": 0.01,
            "vf_coef": 0.5,
            "max_grad_norm": 0.5,
            "normalize_advantage": True,
            "symmetric_views": False,
        },
    ),
    "belief": Entry(
        title="recogniser, Bayes filter and the oracle's votes; not ranked",
        cls="usbench.agents.taught.belief:BeliefAgent",
        policy="MultiInputPolicy",
        policy_kwargs={
            "features_extractor_class": "usbench.agents.taught.belief:LastFrameTrunk",
            "net_arch": [],
        },
        n_envs=32,
        compared=False,
        needs="scene_model",
        hyperparameters={
            "learning_rate": 1e-3,
            "final_learning_rate": 5e-5,
            "buffer_size": 100_000,
            "learning_starts": 1_024,
            "batch_size": 128,
            "train_freq": 32,
            "gradient_steps": 4,
            "target_update_interval": 32,
            "tau": 0.02,
            "exploration_fraction": 0.2,
            "exploration_initial_eps": 1.0,
            "exploration_final_eps": 0.05,
            "max_grad_norm": 10.0,
            "max_shift_px": 0,
        },
    ),
}
