"""The secure router's rules, as committed: who may command, who may only look, and that nothing else is let through."""

import json
from collections import defaultdict

import pytest
import zenoh

from shared.messaging.channels import CHANNELS, PREFIX
from shared.messaging.credentials import SECURE_ROUTER
from shared.messaging.queues import queues_of_router
from shared.runtime.roles import OPERATOR, ROLES, VIEWER
from tools.docs.wiring import PEOPLE, all_wires

ROUTER = zenoh.Config.from_file(SECURE_ROUTER)
ACCESS = json.loads(ROUTER.get_json("access_control"))
COMMANDS = {channel.key_expr for channel in CHANNELS if channel.is_command}


def allowed(role, flow):
    """Key expressions by kind of message."""
    ids = {rule for policy in ACCESS["policies"] if policy["subjects"] == [role] for rule in policy["rules"]}
    keys = defaultdict(set)
    for rule in ACCESS["rules"]:
        if rule["id"] in ids and rule["flows"] == [flow]:
            assert rule["permission"] == "allow"
            for message in rule["messages"]:
                keys[message] |= set(rule["key_exprs"])
    return keys


def who_may(message, key_expr, flow="ingress"):
    sought = zenoh.KeyExpr(key_expr)
    return {
        role for role in ROLES if any(zenoh.KeyExpr(one).intersects(sought) for one in allowed(role, flow)[message])
    }


def test_every_process_has_a_role():
    assert {wired.name for wired in all_wires()} - {PEOPLE} | {OPERATOR} == set(ROLES)


def test_what_no_rule_allows_is_denied_and_a_role_is_shown_by_certificate_and_password():
    assert (ACCESS["enabled"], ACCESS["default_permission"]) == (True, "deny")
    shown = {one["id"]: (one["cert_common_names"], one["usernames"]) for one in ACCESS["subjects"]}
    assert shown == {role: ([role], [role]) for role in ROLES}
    assert ROUTER.get_json("transport/link/tls/enable_mtls") == "true"
    assert ROUTER.get_json("adminspace/permissions") == '{"read":false,"write":false}'
    assert all(endpoint.startswith("tls/") for endpoint in json.loads(ROUTER.get_json("listen/endpoints")))
    assert ROUTER.get_json("scouting/multicast/enabled") == "false"


def test_it_has_the_queues_of_the_embedded_router():
    embedded = zenoh.Config()
    for path, number in queues_of_router().items():
        embedded.insert_json5(path, str(number))
    assert ROUTER.get_json("transport/link/tx/queue") == embedded.get_json("transport/link/tx/queue")


def test_nobody_deletes():
    assert who_may("delete", PREFIX + "**") == set()


@pytest.mark.parametrize(
    ("key", "senders"),
    [
        ("joints/target", {OPERATOR, "planner", "player", "teleop"}),
        ("leg/target", {OPERATOR, "planner", "player", "teleop"}),
        ("actuators/target", {OPERATOR}),
        ("foot/target", {OPERATOR}),
        ("robot/stop", {OPERATOR, "teleop"}),
        ("sim/control", {OPERATOR, "teleop"}),
        ("recorder/control", {OPERATOR, "teleop"}),
        ("replay/control", {OPERATOR}),
    ],
)
def test_who_commands(key, senders):
    assert who_may("put", PREFIX + key) == senders
    assert who_may("query", PREFIX + key) == {OPERATOR}


@pytest.mark.parametrize("key_expr", sorted(COMMANDS))
def test_who_answers_commands(key_expr):
    assert not who_may("reply", key_expr) & {VIEWER, "recorder"} - ({"recorder"} if "recorder/" in key_expr else set())
    assert VIEWER not in who_may("declare_queryable", key_expr)


def test_a_viewer_hears_all_and_says_no_more_than_how_it_is():
    says, hears = allowed(VIEWER, "ingress"), allowed(VIEWER, "egress")
    assert says["put"] == {PREFIX + "health/viewer"}
    assert says["declare_subscriber"] == hears["put"] == {PREFIX + "**"}
    asked = {channel.key_expr for channel in CHANNELS if channel.is_kept and not channel.is_command}
    assert {key.replace("$*", "") for key in says["query"]} == asked


def test_nobody_speaks_for_the_simulation():
    measured = [channel.key_expr for channel in CHANNELS if channel.key in ("joints/state", "tf", "clock", "leg/state")]
    assert [who_may("put", key_expr) for key_expr in measured] == [{"sim"}] * 4
    assert who_may("put", PREFIX + "lidar_rear/points") == {"lidar"}
    assert who_may("liveliness_token", PREFIX + "alive/sim") == {"sim"}


def test_the_mapper_never_hears_the_truth():
    heard = allowed("mapper", "egress")
    assert PREFIX + "tf" not in heard["put"] | heard["reply"]
