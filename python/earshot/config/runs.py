# SPDX-License-Identifier: Apache-2.0
"""Configs of training runs.  Made by scripts/make_config_classes.py from `earshot config --json`."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Literal

from .._section import Section
from .acoustics import Acoustics
from .envs import Agents, Episodes, Filter, Navmesh, Observation, Scenario, Task

if TYPE_CHECKING:
    ArgmaxSample = Literal["argmax", "sample"]
    AutoGlooMpiZeromq = Literal["auto", "gloo", "mpi", "zeromq"]
    ContinueStop = Literal["continue", "stop"]
    MinutesSteps = Literal["minutes", "steps"]
    NextStepOffSameStep = Literal["next_step", "off", "same_step"]
    OnceRandom = Literal["once", "random"]
    SampleTruncatedWorker = Literal["sample", "truncated", "worker"]
else:  # OmegaConf 2.3 knows no Literal and no unions of lists
    ArgmaxSample = str
    AutoGlooMpiZeromq = str
    ContinueStop = str
    MinutesSteps = str
    NextStepOffSameStep = str
    OnceRandom = str
    SampleTruncatedWorker = str


@dataclasses.dataclass(kw_only=True, slots=True)
class Env(Section):
    """Environments: task, sensors, acoustics and where files are."""

    #: Rules of an episode: actions, rewards and its end.
    task: Task = dataclasses.field(default_factory=Task)
    #: Errors that responses may have; a planner chooses the cheapest acoustics within them. Empty: acoustics decides. Range:
    #: errors, for example t20=10%,drr=2dB.
    accuracy: str = ""
    #: Simulation of responses: a preset, and keys over it.
    acoustics: Acoustics = dataclasses.field(default_factory=Acoustics)
    #: Sensors of the agents.
    observation: Observation = dataclasses.field(default_factory=Observation)
    #: Walkable surface and the agent's cylinder.
    navmesh: Navmesh = dataclasses.field(default_factory=Navmesh)
    #: SOFA file with HRTFs, for observation.channels binaural. Empty: a rigid sphere of radius 8.75 cm. Range: a SOFA file.
    hrtf: str = ""
    #: Folder of sounds that an episode set names without a path. Range: a folder.
    sound_root: str = ""
    #: Factor on the dry sound. 12.566371 (4 pi) makes a source as loud at 1 m as its dry clip. Range: above 0.
    sound_gain: float = 1.0
    #: Duration of the fade from one response to the next; at most task.step_time_s. Range: at least 0.
    crossfade_s: float = 0.05
    #: Restarts the sounds at every step, without the reverberation of the steps before; for comparison.
    sound_restarts: bool = False
    #: Agents in each environment. Range: 1 to 16.
    agents: int = 1
    #: Order of episodes. random: drawn without end. once: each of the set once.
    order: OnceRandom = "random"
    #: Start of the next episode. same_step: in the step that ends one. next_step: in the step after. off: by reset() only.
    autoreset: NextStepOffSameStep | None = None
    #: Threads of the batch. 0: all cores. Range: 0 to 1,024.
    threads: int | None = None
    #: Time after which a stage of an environment is given up and its episode quarantined. 0: no limit. Range: 0 to 1,000,000.
    stage_limit_s: float = 0.0
    #: Seed of episodes and noise; in a run config the default is the seed of the run. Range: 0 to 2^64 - 1.
    seed: int | None = None
    #: Folder of relative scene files. Range: a folder.
    scene_root: str = ""
    #: Memory for loaded scenes, of each process. Range: at least 0.
    scene_cache_gb: float = 4.0
    #: Loads the scene and source of an environment's next episode in the background.
    prefetch: bool = True
    #: Folder of source fields that all processes and runs share. Empty: folder fields of a run, otherwise in memory only. Range: a
    #: folder.
    field_store: str = ""
    #: Size of field_store; the least recently used fields are removed first. Range: 0 to 1,000,000,000.
    field_store_gb: float = 20.0
    #: Folder of preprocessed scenes that all processes and runs share. Empty: each process loads them. Range: a folder.
    scene_store: str = ""
    #: Size of scene_store; the least recently used scenes are removed first. Range: 0 to 1,000,000,000.
    scene_store_gb: float = 20.0
    #: Folder for files of quarantined episodes, which earshot replay runs again. Empty: folder quarantine of a run, otherwise none.
    #: Range: a folder.
    quarantine_dir: str = ""


@dataclasses.dataclass(kw_only=True, slots=True)
class Policy(Section):
    """Network of the policy."""

    #: Size of the recurrent state (GRU). Range: 1 to 8,192.
    hidden_size: int = 512
    #: Size of the visual encoder's output. Range: 1 to 8,192.
    visual_features: int = 512
    #: Size of the audio encoder's output. Range: 1 to 8,192.
    audio_features: int = 512
    #: Keeps the recurrent state between steps. false: the agent has no memory; for comparison.
    recurrent: bool = True
    #: Channels of the first convolution; the others have twice as many. Range: 1 to 8,192.
    conv_channels: int = 32
    #: Bias of the action stop before training. At -4 the first episodes are walks of about fifty steps. Range: -20 to 20.
    initial_stop_logit: float = 0.0
    #: Seed of the initial weights; in a run config the default is the seed of the run. Range: 0 to 2^64 - 1.
    seed: int | None = None
    #: The critic reads goal_state beside the recurrent state, in training only (asymmetric actor-critic).
    guided_critic: bool = False
    #: Further outputs that learn the place of the goal; together with guidance.goal.
    goal_heads: bool = False
    #: The critic learns returns normalized by their running mean and deviation (PopArt).
    normalize_values: bool = False
    #: TorchScript file of a network that replaces the built-in one; the sizes above then have no effect. Empty: the built-in
    #: network. Range: a TorchScript file.
    module: str = ""


@dataclasses.dataclass(kw_only=True, slots=True)
class Ppo(Section):
    """Learner: proximal policy optimization with synchronous workers (DD-PPO)."""

    #: Bound of the probability ratio, which stays in 1 - clip to 1 + clip. Range: above 0 and below 1.
    clip: float = 0.2
    #: Weight of the value loss. Range: at least 0.
    value_coefficient: float = 0.5
    #: Weight of the entropy, which rewards exploration. Range: at least 0.
    entropy_coefficient: float = 0.05
    #: Step size of Adam. Range: above 0.
    learning_rate: float = 0.00025
    #: Constant in the denominator of Adam. Range: above 0.
    adam_epsilon: float = 1e-05
    #: Norm to which longer gradients are scaled down. Range: above 0 and at most 1,000,000,000.
    max_gradient_norm: float = 0.2
    #: Passes over each rollout. Range: 1 to 2,147,483,647.
    epochs: int = 2
    #: Minibatches of an epoch; they divide the environments of a worker, sequences stay whole. Range: 1 to 2,147,483,647.
    minibatches: int = 2
    #: Clips the change of the value in the value loss, as the ratio.
    clip_value_loss: bool = True
    #: Normalizes advantages to mean 0 and deviation 1 over all workers.
    normalize_advantages: bool = False
    #: Learning rate falls linearly to 0 over the training.
    linear_learning_rate_decay: bool = False
    #: Clip falls linearly to 0 over the training.
    linear_clip_decay: bool = False
    #: Entropy coefficient falls linearly to 0 over the training.
    linear_entropy_decay: bool = False
    #: Approximate KL divergence above which no further epoch begins. 0: all epochs run. Range: at least 0.
    target_kl: float = 0.0
    #: Fraction of the workers whose rollouts are complete before the others cut theirs short (DD-PPO). 0: all are waited for.
    #: Range: at least 0 and below 1.
    preempt_fraction: float = 0.0
    #: Fraction of its steps that a worker makes before it may be cut short. Range: 0 to 1.
    preempt_least: float = 0.25
    #: Weight of rollouts that were cut short. sample: each sample the same. worker: each worker the same. truncated: each sample by
    #: its importance weight, at most 1.
    preempt_weight: SampleTruncatedWorker = "sample"
    #: Loss above which a minibatch is reported. Range: above 0.
    loss_alarm: float = 30.0
    #: Divergence from the acting policy above which a minibatch is reported. Range: above 0.
    kl_alarm: float = 100.0
    #: How often in a row bad weights are replaced by the last good ones. 0: the run ends. Range: 0 to 2,147,483,647.
    roll_backs: int = 0
    #: Discount of rewards per step. Range: 0 to 1.
    gamma: float = 0.99
    #: Discount of advantages per step (GAE). Range: 0 to 1.
    lambda_: float = 0.95


@dataclasses.dataclass(kw_only=True, slots=True)
class Guidance(Section):
    """Labels of the simulator that training uses beside rewards; none in evaluation."""

    #: Weight of the cross-entropy between the policy and the oracle's action (DAgger), at the start of the training. Range: at
    #: least 0.
    imitation: float = 0.0
    #: Weight of imitation from imitation_until on; it falls linearly to this. Range: at least 0.
    imitation_end_weight: float = 0.0
    #: Fraction of the training after which imitation has its end weight. Range: 0 to 1.
    imitation_until: float = 0.5
    #: Fraction of the episodes in which the oracle acts, at the start; those steps teach by imitation only. Range: 0 to 1.
    oracle: float = 0.0
    #: Fraction of the training after which the oracle acts no more. Range: 0 to 1.
    oracle_until: float = 0.1
    #: Weight of the loss of policy.goal_heads. Range: at least 0.
    goal: float = 0.0


@dataclasses.dataclass(kw_only=True, slots=True)
class HeldOut(Section):
    """Evaluations on data.held_out while the run trains, which choose best.ckpt."""

    #: Updates from one evaluation on data.held_out to the next; the best one is best.ckpt. 0: none. Range: 0 to 2,147,483,647.
    every_updates: int = 0
    #: Largest part of the evaluations in all environment steps, with schedule: minutes in the wall time. Range: above 0 and at most
    #: 1.
    max_fraction: float = 0.1
    #: Evaluations in a row without a better one after which the run ends. 0: any number. Range: 0 to 2,147,483,647.
    patience: int = 0


@dataclasses.dataclass(kw_only=True, slots=True)
class Network(Section):
    """Connections between workers, needed only for several hosts."""

    #: Connection of the workers. auto: zeromq up to 64 workers; beyond, mpi under mpirun and srun --mpi=pmix, else gloo. Same bits.
    collective: AutoGlooMpiZeromq = "auto"
    #: Interface that this worker listens on, such as eth0 or an address. Empty: the one that leads to rank 0. Range: the name or
    #: address of an interface.
    interface: str = ""
    #: Ports to listen on. Empty: any free port, and 20000-29999 for a meeting point whose launcher names none. Range: FIRST-LAST,
    #: ports from 1 to 65535.
    port_range: str = ""
    #: CURVE keys of this worker, a file of mode 0600 made by earshot keys. Range: a key file.
    curve_key_file: str = ""
    #: Public keys that may take part, one per line. Empty: the worker's own key only. Range: a file of public keys.
    allow_list: str = ""
    #: Public key of rank 0. Empty: the worker's own key, where all workers share a key file. Range: a public key, 40 characters.
    meeting_key: str = ""
    #: Workers of one host sum gradients in shared memory.
    shared_memory: bool = True
    #: Allows links between hosts without keys.
    insecure: bool = False
    #: Reaction to a lost worker. stop: the run ends with a checkpoint. continue: the others go on.
    on_loss: ContinueStop = "stop"
    #: Number of times that earshot train --workers N restarts lost workers in one run. Range: 0 to 1,000,000.
    restarts: int = 0
    #: Time without progress after which a worker counts as lost. Range: 0.1 to 1,000,000.
    progress_timeout_s: float = 600.0


@dataclasses.dataclass(kw_only=True, slots=True)
class TrainingEpisodes(Section):
    """Episodes for training."""

    #: Episode set (JSON or JSON.gz), relative to the working folder; made from the other keys where it is missing. Range: an
    #: episode set.
    file: str = ""
    #: Scenes of the episodes. A range stands for several: house:10..14,rooms=3 for five. Range: a SCENE.
    scenes: list[str] = dataclasses.field(default_factory=list)
    #: Sounds, drawn per episode: files, folders of files, or synth:KIND:SEED. synth:bird:0..3 stands for four. Range: a sound.
    sounds: list[str] = dataclasses.field(default_factory=list)
    #: Episodes generated in each scene. Range: 1 to 2,147,483,647.
    episodes_per_scene: int = 50
    #: Goals that the episodes of a scene share, far from each other. 0: each episode has its own goal. Range: 0 to 100,000.
    goals_per_scene: int = 10
    #: Seed of the generated episodes. Range: 0 to 2^64 - 1.
    seed: int = 0
    #: Generated episodes that are kept.
    filter: Filter = dataclasses.field(default_factory=Filter)
    #: Onset, duration, distractors and noise of generated episodes.
    scenario: Scenario = dataclasses.field(default_factory=Scenario)
    #: Agents of generated episodes.
    agents: Agents = dataclasses.field(default_factory=Agents)


@dataclasses.dataclass(kw_only=True, slots=True)
class Data(Section):
    """Episodes of the run."""

    #: Episodes for training.
    train: TrainingEpisodes = dataclasses.field(default_factory=TrainingEpisodes)
    #: Episodes for evaluation, which training does not see.
    eval: Episodes = dataclasses.field(default_factory=Episodes)
    #: Episodes for evaluations while the run trains (held_out), in other scenes than train and eval.
    held_out: Episodes = dataclasses.field(default_factory=Episodes)


@dataclasses.dataclass(kw_only=True, slots=True)
class RunConfig(Section):
    """A training run, read by earshot train, plan, eval and others; configs/train."""

    #: Version of the file format; a program refuses versions that it does not know. Range: 1.
    schema_version: int = 1
    #: Name of the run.
    name: str = "run"
    #: Folder of checkpoints, curves and results; default: runs/NAME. Range: a folder.
    out: str | None = None
    #: Seed of the run: of env.seed and policy.seed unless they are set, and of sampled actions. Range: 0 to 2^64 - 1.
    seed: int = 0
    #: Worker processes on this machine; a launcher takes precedence. Range: 1 to 1,024.
    workers: int = 1
    #: Environments of each worker. Range: 1 to 2,147,483,647.
    envs_per_worker: int = 8
    #: Steps of each environment between two updates. Range: 1 to 2,147,483,647.
    rollout_steps: int = 150
    #: Steps the environments in two halves, one while the policy computes the other's actions.
    overlap: bool = False
    #: Environment steps of the training, over all workers. Range: 1 to 2^64 - 1.
    total_steps: int = 1000000
    #: Wall time of the training. 0: no bound. Range: at least 0.
    max_minutes: float = 0.0
    #: Updates between two periodic checkpoints. Range: 1 to 2,147,483,647.
    checkpoint_every: int = 50
    #: Periodic checkpoints that are kept, beside the best and the last. Range: 1 to 2,147,483,647.
    keep: int = 3
    #: Text file for Prometheus that each update replaces. Empty: none. Range: a file.
    metrics_file: str = ""
    #: Environments of the evaluation; a part of its bits. Range: 1 to 2,147,483,647.
    eval_envs: int = 8
    #: Policy whose weights a new run starts from. Empty: random weights from policy.seed. Range: a policy file, checkpoint or run
    #: folder.
    initial_policy: str = ""
    #: Measure of progress for decays and guidance. steps: total_steps, the same bits on every machine. minutes: total_steps or
    #: max_minutes, whichever comes first.
    schedule: MinutesSteps = "steps"
    #: Actions of the evaluated policy. sample: drawn from its distribution. argmax: the likeliest.
    eval_actions: ArgmaxSample = "sample"
    #: Environments: task, sensors, acoustics and where files are.
    env: Env = dataclasses.field(default_factory=Env)
    #: Network of the policy.
    policy: Policy = dataclasses.field(default_factory=Policy)
    #: Learner: proximal policy optimization with synchronous workers (DD-PPO).
    ppo: Ppo = dataclasses.field(default_factory=Ppo)
    #: Labels of the simulator that training uses beside rewards; none in evaluation.
    guidance: Guidance = dataclasses.field(default_factory=Guidance)
    #: Evaluations on data.held_out while the run trains, which choose best.ckpt.
    held_out: HeldOut = dataclasses.field(default_factory=HeldOut)
    #: Connections between workers, needed only for several hosts.
    network: Network = dataclasses.field(default_factory=Network)
    #: Episodes of the run.
    data: Data = dataclasses.field(default_factory=Data)
