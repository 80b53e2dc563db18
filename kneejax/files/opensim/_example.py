"""The smallest OpenSim model that has a knee, for examples."""

#: A right knee of one hinge and one fibre: in schema 4, in metres and newtons.
SMALLEST_MODEL = """<?xml version="1.0" encoding="UTF-8"?>
<OpenSimDocument Version="40000">
  <Model name="smallest">
    <length_units>meters</length_units>
    <force_units>N</force_units>
    <BodySet><objects><Body name="femur_r"/><Body name="tibia_r"/></objects></BodySet>
    <JointSet><objects>
      <PinJoint name="knee_r">
        <socket_parent_frame>/bodyset/femur_r</socket_parent_frame>
        <socket_child_frame>/bodyset/tibia_r</socket_child_frame>
        <coordinates><Coordinate name="knee_angle_r"/></coordinates>
      </PinJoint>
    </objects></JointSet>
    <ForceSet><objects>
      <Blankevoort1991Ligament name="LCL">
        <GeometryPath><PathPointSet><objects>
          <PathPoint name="origin">
            <socket_parent_frame>/bodyset/femur_r</socket_parent_frame>
            <location>0.002 0.004 0.038</location>
          </PathPoint>
          <PathPoint name="insertion">
            <socket_parent_frame>/bodyset/tibia_r</socket_parent_frame>
            <location>-0.018 -0.052 0.036</location>
          </PathPoint>
        </objects></PathPointSet></GeometryPath>
        <linear_stiffness>2000</linear_stiffness>
        <slack_length>0.057</slack_length>
      </Blankevoort1991Ligament>
    </objects></ForceSet>
  </Model>
</OpenSimDocument>
"""
