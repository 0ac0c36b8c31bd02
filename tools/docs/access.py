"""The secure router's configuration: what each role may say and hear, derived from the wiring."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from shared.messaging.channels import ALIVE, CHANNELS, HEALTH, PREFIX, PUBLISHED, SENSOR_CHANNELS, Channel
from shared.runtime.roles import OPERATOR, VIEWER
from tools.docs.wiring import PEOPLE, Wires

_HEAD = """\
// The router of a secure bus: whoever connects shows a certificate and a password, and may do what is allowed below.
// Made from the wiring of the services by `python -m tools.docs`. What is not allowed is refused, silently.
{
  mode: "router",
  listen: { endpoints: ["tls/0.0.0.0:7447"] },
  scouting: { multicast: { enabled: false }, gossip: { enabled: false } },
  // Nothing enters through the router itself, which is above the rules: no admin space, no plugins.
  adminspace: { permissions: { read: false, write: false } },
  timestamping: { enabled: true },
  transport: {
    link: {
      // `hyrecro certs new` makes these files; `hyrecro router` looks for them in bus.credentials instead.
      tls: {
        root_ca_certificate: "/credentials/router/ca.pem",
        listen_certificate: "/credentials/router/router.pem",
        listen_private_key: "/credentials/router/router.key",
        enable_mtls: true,
        close_link_on_expiration: true,
      },
      // As in configs/zenoh/router.json5: room for each kind of message, and no subscriber that holds up the others.
      tx: {
        queue: {
          size: { interactive_high: 16, data: 16, data_low: 16 },
          congestion_control: { drop: { wait_before_drop: 1000 }, block: { wait_before_close: 1000000 } },
        },
      },
    },
    shared_memory: { transport_optimization: { enabled: false } },
    auth: { usrpwd: { dictionary_file: "/credentials/router/passwords" } },
  },
  access_control: {
    enabled: true,
    default_permission: "deny",
"""
_LINE_LENGTH = 120
_CHANNELS = {channel.key: channel for channel in CHANNELS}
_EVERYTHING = PREFIX + "**"
_ALL_ALIVE, _ALL_PUBLISHED = ALIVE.removesuffix("*") + "**", PUBLISHED


@dataclass
class Access:
    """What one role may do, by Zenoh's name of a message: on which keys from it to the router, and back."""

    role: str
    ingress: dict[str, set[str]] = field(default_factory=lambda: defaultdict(set))
    egress: dict[str, set[str]] = field(default_factory=lambda: defaultdict(set))

    def flows(self) -> dict[str, dict[str, set[str]]]:
        """By Zenoh's name of the direction."""
        return {"ingress": self.ingress, "egress": self.egress}

    def allow(self, flow: dict[str, set[str]], messages: Iterable[str], key_expr: str) -> None:
        """Lets messages on a key pass in one of this role's directions."""
        for message in messages:
            flow[message].add(key_expr)

    def may_publish(self, channel: Channel) -> None:
        """Sends it; learns who listens, also to more than this; answers with the last one where it is kept."""
        key_expr = _pattern(channel)
        self.allow(self.ingress, ["put"], key_expr)
        self.allow(self.egress, ["declare_subscriber"], _EVERYTHING)
        self.allow(self.ingress, ["liveliness_token"], _published(channel))
        if channel.is_kept:
            self.allow(self.ingress, ["declare_queryable", "reply"], key_expr)
            self.allow(self.egress, ["query"], key_expr)

    def may_command(self, channel: Channel) -> None:
        """Sends a command by a query too, and gets its answer."""
        key_expr = _pattern(channel)
        self.allow(self.ingress, ["put", "query"], key_expr)
        self.allow(self.egress, ["declare_queryable", "reply"], key_expr)
        self.allow(self.egress, ["declare_subscriber"], _EVERYTHING)

    def may_read(self, channel: Channel) -> None:
        """Hears it, and asks for the last one where it is kept."""
        key_expr = _pattern(channel)
        self.allow(self.ingress, ["declare_subscriber"], key_expr)
        self.allow(self.egress, ["put"], key_expr)
        if channel.is_kept:
            self.allow(self.ingress, ["query"], key_expr)
            self.allow(self.egress, ["declare_queryable", "reply"], key_expr)
            self.allow(self.ingress, ["liveliness_query", "declare_liveliness_subscriber"], _published(channel))
            self.allow(self.egress, ["liveliness_token"], _published(channel))

    def may_obey(self, channel: Channel, *, is_answered: bool) -> None:
        """Takes a command by put and by query, and answers the query where that is its part."""
        key_expr = _pattern(channel)
        self.allow(self.ingress, ["declare_subscriber", "declare_queryable"], key_expr)
        self.allow(self.egress, ["put", "query"], key_expr)
        if is_answered:
            self.allow(self.ingress, ["reply"], key_expr)

    def may_see_who_is_there(self) -> None:
        """Asks which services are alive and which keys are published, and is told when that changes."""
        for key_expr in (_ALL_ALIVE, _ALL_PUBLISHED):
            self.allow(self.ingress, ["liveliness_query", "declare_liveliness_subscriber"], key_expr)
            self.allow(self.egress, ["liveliness_token"], key_expr)

    def may_live(self, name: str) -> None:
        """Says that it is alive, and in which health; asks who else is alive."""
        self.may_publish(HEALTH.of(_sensors_too(name)))
        self.allow(self.ingress, ["liveliness_token"], ALIVE.replace("*", _sensors_too(name)))
        self.allow(self.ingress, ["liveliness_query"], _ALL_ALIVE)
        self.allow(self.egress, ["liveliness_token"], _ALL_ALIVE)


def router_file(wires: Sequence[Wires]) -> str:
    """The whole configuration, as JSON5."""
    by_name = {wired.name: wired for wired in wires}
    services = [_service(by_name[name]) for name in by_name if name not in (PEOPLE, VIEWER)]
    accesses = [_operator(by_name), _viewer(), *services]
    roles = [access.role for access in accesses]
    subjects = [f'      {{ id: "{role}", cert_common_names: ["{role}"], usernames: ["{role}"] }},' for role in roles]
    lines = [
        "    // Certificate and password must name the same role.",
        "    subjects: [",
        *subjects,
        "    ],",
        "    rules: [",
    ]
    policies = []
    for access in accesses:
        rules = _rules(access)
        lines += [line for text in rules.values() for line in text]
        ids = [f'"{rule}"' for rule in rules]
        policies += [
            f'      {{ id: "{access.role}", subjects: ["{access.role}"], rules: [',
            *_wrapped(ids),
            "      ] },",
        ]
    return _HEAD + "\n".join([*lines, "    ],", "    policies: [", *policies, "    ],", "  },", "}", ""])


def _service(wired: Wires) -> Access:
    access = Access(wired.name)
    access.may_live(wired.name)
    for key in wired.sends - {HEALTH.key}:
        access.may_publish(_CHANNELS[key])
    for key in wired.takes:
        channel = _CHANNELS[key]
        if channel.is_command:
            access.may_obey(channel, is_answered=key in wired.answers)
        else:
            access.may_read(channel)
    return access


def _operator(by_name: dict[str, Wires]) -> Access:
    """Commands and reads, from the shell, by a player or by a page."""
    access = _service(by_name["player"])
    access.role = OPERATOR
    page = _service(by_name["teleop"])
    for mine, pages in zip(access.flows().values(), page.flows().values(), strict=True):
        for message, key_exprs in pages.items():
            mine[message] |= key_exprs
    for key in by_name[PEOPLE].sends:
        access.may_command(_CHANNELS[key])
    _read_everything(access)
    return access


def _viewer() -> Access:
    """Reads, and says no more than how it is itself: an event of a viewer could end somebody's motion."""
    access = Access(VIEWER)
    _read_everything(access)
    return access


def _read_everything(access: Access) -> None:
    access.allow(access.ingress, ["declare_subscriber"], _EVERYTHING)
    access.allow(access.egress, ["put"], _EVERYTHING)
    access.may_live(VIEWER)
    access.may_see_who_is_there()
    for channel in CHANNELS:
        if not channel.is_command:
            access.may_read(channel)


def _rules(access: Access) -> dict[str, list[str]]:
    """Lines by the rule's id, one rule a direction and kind of message."""
    rules = {}
    for flow, messages in access.flows().items():
        for message, key_exprs in sorted(messages.items()):
            rule = f"{access.role} {flow} {message}"
            kept = [_EVERYTHING] if _EVERYTHING in key_exprs else sorted(key_exprs)
            rules[rule] = [
                f'      {{ id: "{rule}", permission: "allow", flows: ["{flow}"], messages: ["{message}"],',
                "        key_exprs: [",
                *_wrapped([f'"{key_expr}"' for key_expr in kept]),
                "      ] },",
            ]
    return rules


def _wrapped(words: Sequence[str]) -> list[str]:
    lines = [" " * 7]
    for word in words:
        if len(lines[-1]) + len(word) + 2 > _LINE_LENGTH:
            lines.append(" " * 7)
        lines[-1] += f" {word},"
    return lines


def _pattern(channel: Channel) -> str:
    """The key of a channel, and of the same channel of further sensors: `lidar_rear/points` of `lidar/points`."""
    return PREFIX + _sensors_too(channel.key)


def _published(channel: Channel) -> str:
    return PUBLISHED.replace("**", _sensors_too(channel.key))


def _sensors_too(key: str) -> str:
    head, slash, rest = key.partition("/")
    return f"{head}$*{slash}{rest}" if head in SENSOR_CHANNELS else key
