# SPDX-License-Identifier: Apache-2.0
"""The table of failures that must be survived."""

from tests.failures import (
    board_failures,
    command_failures,
    link_failures,
    robot_failures,
    session_failures,
    stranger_failures,
)
from tests.failures.scenario import Scenario

SCENARIOS: tuple[Scenario, ...] = (
    Scenario(
        1,
        "The port is missing, busy, or no serial port",
        "The bridge ends within 10 s with exit code 1 and one line that names port and remedy. Nothing was opened by half.",
        "What the line says; `./sixstrut doctor --port PORT` looks at everything around it.",
        link_failures.bad_port,
    ),
    Scenario(
        2,
        "The link is lost in mid-gait",
        "A write that fails is noticed at once, silence after 4 s. FAULT is latched, motion and roll end as failed, and "
        "nothing goes on by itself when the link is back.",
        "Check power and range, `reset`, look where the struts are, `arm`.",
        link_failures.lost_in_mid_gait,
    ),
    Scenario(
        3,
        "The board goes on with its last move after the link died",
        "Frames are 50 ms of motion each, so little is left: see the table below. An actuator that lags behind its "
        "commands goes on until it is where it was last sent.",
        "Keep clear until it stands; the switch in the servo supply stops it at once.",
        board_failures.link_dies,
    ),
    Scenario(
        4,
        "A write is cut, or the port takes no more bytes",
        "A write that is not taken whole within 40 ms is counted and latches FAULT; `reset` first brings the board out of "
        "a half frame. A frame cut on its way costs that frame, not the motion.",
        "`reset`, `arm`. On a Maestro a cut frame may move the struts: look first.",
        link_failures.cut_and_blocked,
    ),
    Scenario(
        5,
        "Answers are short, late, changed, or left over",
        "An answer counts only with the exact length and possible values; what was there before a question is dropped, a "
        "bad answer is asked again, and all is counted. Four seconds without a good one are a lost link.",
        "Nothing; if the counts grow, check range and wiring.",
        link_failures.garbled_answers,
    ),
    Scenario(
        6,
        "The commander falls silent",
        "After 1 s the motion ends in HOLD, struts held where they are, and the lease is lost.",
        "`arm` again, which homes again.",
        command_failures.silent_commander,
    ),
    Scenario(
        7,
        "A command is nonsense: not a number, out of range, too fast, wrong names or count, old, a bad shape",
        "It is refused whole with strut, value and limit; nothing moves, the state stays.",
        "Correct the command.",
        command_failures.bad_motions,
    ),
    Scenario(
        8,
        "The board browns out, resets, or is switched off and on",
        "Noticed as in the table below, where the board lets it be noticed: FAULT, nothing more is sent, and nobody knows "
        "where the struts are. On an LSC a sagging supply refuses the next gait.",
        "See where each strut is, check the supply, `reset`, `arm` with confirmed lengths: homing is needed.",
        board_failures.board_resets,
    ),
    Scenario(
        9,
        "A second bridge, a second program at the port, a second commander",
        "A second bridge ends with exit code 1, another program cannot open the port, a second commander is refused by "
        "name. The first goes on.",
        "Stop the other one, or have it `disarm`.",
        command_failures.second_ones,
    ),
    Scenario(
        10,
        "Somebody's clock is another one (`use_sim_time`, `/clock`)",
        "Frames, lease and heartbeat run on the steady clock. A bridge with `use_sim_time` ends with one line, a command from "
        "another clock is refused as old, and `/clock` beside it does nothing.",
        "Leave `use_sim_time` false for a robot; set the computers' clocks.",
        command_failures.other_clocks,
    ),
    Scenario(
        11,
        "The log cannot be written: folder, full disk, a disk that dies",
        "Without a log the bridge does not start; with too little space nothing is armed or moved; when it dies in "
        "mid-motion the motion is held. The way back to mid stroke stays open, and what was written is kept.",
        "Free space, or another `bag_folder`; `record:=false` does without.",
        session_failures.log_fails,
    ),
    Scenario(
        12,
        "The bridge is killed while it records (SIGKILL)",
        "Every message that was told as written is there: the next start makes a whole bag of the journal, and says so.",
        "Start the bridge again.",
        session_failures.killed_while_recording,
    ),
    Scenario(
        13,
        "SIGINT or SIGTERM in mid-gait, also twice",
        "Struts are held, the log is closed, exit code 0. A second signal disturbs nothing.",
        "Nothing.",
        session_failures.signals_in_mid_gait,
    ),
    Scenario(
        14,
        "Stop is pressed, while a rehearsal loads all cores",
        "FAULT is latched; after the call at most one frame goes out, then the one that holds. Later commands are refused "
        "with the reason.",
        "Remove the cause, `reset`, `arm`. A software stop is not an emergency stop.",
        command_failures.stop_pressed,
    ),
    Scenario(
        15,
        "The duty budget is spent, the battery is low, a strut stalls",
        "The next gait is refused until the actuators have rested, the battery is charged, the strut is where it was "
        "sent. The way back to mid stroke is open. A stall is noticed only if somebody sees the struts: no board tells "
        "it.",
        "Wait, charge, free the strut.",
        command_failures.spent_actuators,
    ),
    Scenario(
        16,
        "Bluetooth is slow, the port backs up",
        "A frame that would only queue is not sent: the motion waits for the link and goes on with its path. Latencies "
        "are in `/diagnostics`.",
        "Come nearer; look at the latencies of replies.",
        link_failures.slow_link,
    ),
    Scenario(
        17,
        "A node dies and is started again",
        "The bridge comes back DISARMED, the planner without a lease (meanwhile the struts are held), the twin joins "
        "where the robot stands.",
        "`arm` again.",
        session_failures.nodes_die,
    ),
    Scenario(
        18,
        "Library, model or calibration do not go together",
        "A motion from another library than the bag's, a replay with another model, a calibration for another board: "
        "refused, and both sides are named.",
        "Start everything with the same files.",
        session_failures.what_does_not_go_together,
    ),
    Scenario(
        19,
        "Stop is pressed while the bridge is flooded, or stands still over a message of 300,000 points",
        "Port, frame timer and stop are in a process that reads no other message: at most one frame goes out, then the one that "
        "holds. Too long a goal is refused by its size; what others publish goes into the bag within a quota.",
        "Find out who sends it.",
        stranger_failures.stop_under_load,
    ),
    Scenario(
        20,
        "A recording is played beside the robot, under the live names",
        "Nothing moves and nobody is misled: what has old stamps or belongs to another session of a bridge is ignored, with one "
        "warning; a `goal_pose` without a fresh stamp is refused.",
        "Play bags in a ROS domain of their own.",
        stranger_failures.recording_played,
    ),
    Scenario(
        21,
        "Another robot's bridge answers to the same names",
        "The second one ends with exit code 1; while both are heard, neither is armed.",
        "A namespace or a ROS domain for each robot.",
        stranger_failures.second_bridge,
    ),
    Scenario(
        22,
        "Nobody answers at the port: no power, wrong port, wrong rate",
        "A board that has not answered since the port was opened is not armed.",
        "Power, port, rate, the wire that it answers on; a board that cannot answer needs the word `silent_board:=true`.",
        robot_failures.silent_board,
    ),
    Scenario(
        23,
        "Another robot, or another calibration, at the same port",
        "Last pulses belong to a robot, its calibration and its board: of another one nobody knows where its struts are, and "
        "it is not armed.",
        "See where each strut is, and confirm the lengths with `arm`.",
        robot_failures.another_robot,
    ),
    Scenario(
        24,
        "A journal is damaged in its middle (a page of zeros)",
        "Only the damaged place is lost. The journal is kept, and the line and the bag say how much could not be read.",
        "Look at the disk.",
        robot_failures.damaged_journal,
    ),
    Scenario(
        25,
        "The inertial sensor in the box is unplugged, freezes, or turns in its mount",
        "Unplugged or frozen while struts move, the face is unknown, and told again when the sensor is back and the robot rests. "
        "One that turned is not believed until somebody says the face and it agrees.",
        "Fix it; after a turn `calibrate imu` again.",
        robot_failures.sensor_fails,
    ),
)

RUNNING_ORDER = (1, 4, 5, 6, 7, 9, 21, 22, 23, 24, 19, 16, 14, 18, 10, 15, 11, 12, 17, 20, 13, 2, 3, 8, 25)
"""So that as many as can share a stack, and those that kill it come last."""


def scenario(number: int) -> Scenario:
    """A row. Raises KeyError."""
    return {row.number: row for row in SCENARIOS}[number]
