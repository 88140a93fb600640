"""What the package offers to command line, Python and launcher."""

from trepid.packages import Offers, Verb

OFFERS = Offers(
    verbs={
        "networks": Verb(
            "learning.networks_cli",
            "app",
            "Segmentation networks of lane lines and drivable area, for real roads.",
        ),
        "dataset": Verb(
            "learning.dataset.cli", "app", "Data sets of recorded drives: build, look at, convert."
        ),
        "train": Verb(
            "learning.training.cli",
            "train",
            "Train a network to steer from the frames of a data set; needs the extra 'train'.",
        ),
        "quantise": Verb(
            "learning.training.cli",
            "quantise",
            "Convert a driving network to 8 bits where this pays; needs the extra 'train'.",
        ),
        "correct": Verb(
            "learning.correcting.cli",
            "correct",
            "Let a network drive alone in the simulator, label where it drifts, train again;"
            " needs the extra 'train'.",
        ),
        "train-lane": Verb(
            "learning.lane.train",
            "train",
            "Train the CNN estimator on rendered roads and write its weights; needs the extra 'train'.",
        ),
        "evaluate": Verb(
            "learning.judging.cli",
            "evaluate",
            "Judge driving networks on recorded angles, beside predictions without an image, on one core.",
        ),
        "train-lead": Verb(
            "learning.lead.train",
            "train_lead",
            "Train the lead detector on rendered vehicles and write its weights; needs the extra 'train'.",
        ),
    },
    examples={
        "networks list": "trepid networks list",
        "networks fetch": "trepid networks fetch twinlitenet",
        "train-lane": "trepid train-lane --out out/train",
        "train": "trepid train --data drives --model pilotnet --out net.onnx",
        "quantise": "trepid quantise net.onnx --data drives --out net-8.onnx",
        "correct": "trepid correct --data drives --model steer --scenario s_curve --rounds 3 --out net.onnx",
        "train-lead": "trepid train-lead --out out/lead",
        "dataset build": "trepid dataset build drives mycar/tub --lock-deg 25",
        "dataset show": "trepid dataset show drives --picture drives.png",
        "dataset export": "trepid dataset export drives mytub --as tub",
        "evaluate": "trepid evaluate net.onnx --data drives",
    },
)
