"""Webhooks and their deliveries."""

from datetime import datetime
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, StrictBool

from server.schemas.common import Description, Given
from server.states import DeliveryState, WebhookEvent

WebhookUrl = Annotated[str, Field(min_length=1, max_length=500)]
WebhookEvents = Annotated[list[WebhookEvent], Field(min_length=1, max_length=len(WebhookEvent))]
WHEN_ENDED = [
    WebhookEvent.EVALUATION_COMPLETED,
    WebhookEvent.EVALUATION_INCOMPLETE,
    WebhookEvent.EVALUATION_CANCELLED,
]


class WebhookCreate(Given):
    """An address that is to be told what happens."""

    url: WebhookUrl  # https://…
    events: WebhookEvents = WHEN_ENDED
    everybodys: StrictBool = False  # else of one's own evaluations alone
    description: Description = ""


class WebhookChange(Given):
    """What is to be different about a webhook; what is left out stays."""

    url: WebhookUrl = ""
    events: WebhookEvents = WHEN_ENDED
    everybodys: StrictBool = False
    description: Description = ""
    active: StrictBool = True


class WebhookPublic(BaseModel):
    """A webhook without its secret."""

    model_config = ConfigDict(from_attributes=True)

    id: str
    url: str
    events: list[WebhookEvent]
    everybodys: bool
    description: str
    active: bool
    reason: str | None  # why it is not active, if nobody switched it off
    created: datetime


class WebhookCreated(WebhookPublic):
    """A webhook with what its deliveries are signed with; it is told this once."""

    secret: str  # whsec_…, as of https://www.standardwebhooks.com


class DeliveryTry(BaseModel):
    """One try to deliver."""

    time: datetime
    status: int | None  # that the receiver answered, as HTTP
    error: str | None  # why there is none


class DeliveryPublic(BaseModel):
    """An event on its way to a webhook."""

    model_config = ConfigDict(from_attributes=True)

    id: str  # its `webhook-id`
    kind: WebhookEvent
    state: DeliveryState
    body: str  # as it is signed
    tries: list[DeliveryTry]
    due: datetime | None  # the next try
    created: datetime
