// Not run by its authors. Plant and controller as FMUs of Dymola, model exchange.
model Axis
  plant_fmu plant;
  iol_fmu iol;
  output Real x(unit="m") "position of the block";
  output Real u(unit="V") "motor terminal voltage";
equation
  iol.x_d = 0.08;
  iol.x = plant.x;
  iol.v = plant.v;
  iol.z = plant.z;
  iol.i = plant.i;
  plant.u = iol.u;
  // left over: the law's ports, of which a common solver needs none
  plant.u_gain_x = 0;
  plant.u_gain_v = 0;
  plant.u_gain_z = 0;
  plant.u_gain_i = 0;
  plant.u_ref_x = 0;
  plant.u_ref_v = 0;
  plant.u_ref_z = 0;
  plant.u_ref_i = 0;
  plant.u_rate = 0;
  x = plant.x;
  u = iol.u;
end Axis;
