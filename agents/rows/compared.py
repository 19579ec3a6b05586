"""The rows of the comparison: the paper's algorithm and those that it is compared with."""

from usbench.agents.hyperparameters import Value
from usbench.agents.rows.entry import REPLAY, RUNNING, SEPARATE, TRUNK, Entry

TABLE_II: dict[str, Value] = {
    "learning_rate": 1e-4,
    "value_learning_rate": 1e-3,
    "n_steps": 64,
    "gamma": 0.99,
    "gae_lambda": 0.97,
    # From here on the paper leaves the value open.
    "n_value_steps": 3,
    # What the random agent would collect without end, at -1.3 per step: see the class.
    "initial_value": -130.0,
    "adam_beta1": 0.0,
}
# Before the search, which replaces hyperparameters of its spaces.
COMPARED: dict[str, Entry] = {
    "vpg": Entry(
        title="the paper's vanilla policy gradient, with its Table II",
        cls="usbench.agents.vpg:VPG",
        policy="CnnPolicy",
        hyperparameters=TABLE_II,
        tasks={
            "fp": {"gae_lambda": 0.95},
            "pp": {"gae_lambda": 0.97},
            "fp-random": {"gae_lambda": 0.95},
            # What the random agent would collect without end, at 1.4 per step.
            "setup": {"initial_value": 140.0},
            "setup-v0": {"initial_value": 140.0},
        },
        presets={"spinup": {"n_value_steps": 80}},
    ),
    "vpg-tuned": Entry(
        title="the paper's algorithm, hyperparameters chosen by the search",
        cls="usbench.agents.vpg:VPG",
        policy="CnnPolicy",
        hyperparameters=TABLE_II,
    ),
    "a2c": Entry(
        title="advantage actor-critic (Mnih et al. 2016)",
        cls="usbench.agents.on_policy:A2C",
        policy="MlpPolicy",
        policy_kwargs=SEPARATE,
        hyperparameters={
            "learning_rate": 1e-4,
            "n_steps": 64,
            "gamma": 0.9,
            "gae_lambda": 0.95,
            "ent_coef": 0.01,
            "vf_coef": 0.5,
            "max_grad_norm": 0.5,
            "normalize_advantage": True,
            # SB3's default corrects no bias: RMSprop's first steps are ten times the learning rate.
            "use_rms_prop": False,
        },
    ),
    "ppo": Entry(
        title="proximal policy optimisation (Schulman et al. 2017)",
        cls="usbench.agents.on_policy:PPO",
        policy="MlpPolicy",
        policy_kwargs=SEPARATE | RUNNING,
        hyperparameters={
            "learning_rate": 6e-4,
            "n_steps": 256,
            "batch_size": 128,
            "n_epochs": 6,
            "gamma": 0.9,
            "gae_lambda": 1.0,
            "clip_range": 0.1,
            "ent_coef": 0.025,
            "vf_coef": 0.5,
            "max_grad_norm": 0.5,
            "normalize_advantage": True,
        },
    ),
    "dqn": Entry(
        title="deep Q-network (Mnih et al. 2015)",
        cls="stable_baselines3:DQN",
        policy="MlpPolicy",
        policy_kwargs=TRUNK | RUNNING,
        kwargs=REPLAY,
        hyperparameters={
            "learning_rate": 7e-5,
            # The paper's whole budget: the buffer forgets no step.
            "buffer_size": 16_064,
            "learning_starts": 500,
            "batch_size": 64,
            "gamma": 0.8,
            "train_freq": 8,
            "gradient_steps": 1,
            "target_update_interval": 500,
            "tau": 1.0,
            "exploration_fraction": 0.1,
            "exploration_initial_eps": 1.0,
            "exploration_final_eps": 0.02,
            "max_grad_norm": 10.0,
        },
    ),
    "qrdqn": Entry(
        title="DQN with quantile regression (Dabney et al. 2018)",
        cls="sb3_contrib:QRDQN",
        policy="MlpPolicy",
        policy_kwargs=TRUNK | RUNNING | {"n_quantiles": 50},
        kwargs=REPLAY,
        hyperparameters={
            "learning_rate": 1e-4,
            "buffer_size": 16_064,
            "learning_starts": 500,
            "batch_size": 32,
            "gamma": 0.9,
            "train_freq": 4,
            "gradient_steps": 1,
            "target_update_interval": 500,
            "tau": 1.0,
            "exploration_fraction": 0.3,
            "exploration_initial_eps": 1.0,
            "exploration_final_eps": 0.05,
            "max_grad_norm": 10.0,
        },
    ),
    "trpo": Entry(
        title="trust region policy optimisation (Schulman et al. 2015)",
        cls="usbench.agents.on_policy:TRPO",
        policy="MlpPolicy",
        policy_kwargs=SEPARATE | RUNNING,
        kwargs_with_senses={"rollout_buffer_class": "usbench.agents.dict_rollout:SliceableRolloutBuffer"},
        hyperparameters={
            "learning_rate": 1e-3,
            "n_steps": 256,
            "batch_size": 64,
            "gamma": 0.9,
            "gae_lambda": 0.95,
            "target_kl": 0.01,
            "cg_max_steps": 5,
            "cg_damping": 0.1,
            # The graph of second derivatives of the whole rollout would take gigabytes.
            "sub_sampling_factor": 4,
            "n_critic_updates": 4,
            "normalize_advantage": True,
        },
    ),
    "recurrent_ppo": Entry(
        title="PPO with an LSTM",
        cls="sb3_contrib:RecurrentPPO",
        policy="MlpLstmPolicy",
        policy_kwargs=SEPARATE
        | RUNNING
        | {
            "features_extractor_class": "usbench.agents.networks:ProjectedTrunk",
            "lstm_hidden_size": 64,
        },
        hyperparameters={
            # Ten times that of PPO: a weight has less effect with 64 features than with the trunk's 7040.
            "learning_rate": 1e-3,
            "n_steps": 256,
            "batch_size": 64,
            "n_epochs": 4,
            "gamma": 0.9,
            "gae_lambda": 0.95,
            "clip_range": 0.2,
            "ent_coef": 0.01,
            "vf_coef": 0.5,
            "max_grad_norm": 0.5,
            "normalize_advantage": True,
        },
    ),
}
