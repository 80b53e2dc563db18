"""Claims of paper 3 on its knee: laxity, and the raised leg with a rigid patella."""

from kneejax.reproduction.paper3._claims import paper3_claims as paper3_claims
from kneejax.reproduction.paper3._leg_study import BODY_KG as BODY_KG
from kneejax.reproduction.paper3._leg_study import HEIGHT_M as HEIGHT_M
from kneejax.reproduction.paper3._leg_study import RaisedLeg as RaisedLeg
from kneejax.reproduction.paper3._leg_study import raised_leg as raised_leg
from kneejax.reproduction.paper3._rigid_leg import RigidLeg as RigidLeg
from kneejax.reproduction.paper3._rigid_leg import held_by_rigid_patella as held_by_rigid_patella
from kneejax.reproduction.paper3._rigid_leg import rigid_leg as rigid_leg
from kneejax.reproduction.paper3._rigid_patella import RigidPatella as RigidPatella
from kneejax.reproduction.paper3._simple_surfaces import rigid_patella_of as rigid_patella_of
from kneejax.reproduction.paper3._study import TORSION_DEG as TORSION_DEG
from kneejax.reproduction.paper3._study import Paper3Study as Paper3Study
from kneejax.reproduction.paper3._study import paper3_study as paper3_study
