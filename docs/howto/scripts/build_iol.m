% Not run by its authors: written after the maker's documentation, checked for syntax alone.
% It makes the model iol_axis of plant.fmu and iol.fmu, runs it, and compares it with iol_step.csv.
%
%   ballscrew export --native --platforms win64 --only plant iol --out native
%
% Put this file and iol_step.csv into the folder of the FMUs and run it there.
% way: 'ModelExchange', or 'CoSimulation' with the law's ports.

way = 'ModelExchange';
model = 'iol_axis';
stop = 2;  % [s]
goal = 0.08;  % [m]
step = 2e-4;  % communication step [s], of co-simulation
allowed = 1e-4;  % [m]

here = fileparts(mfilename('fullpath'));
addpath(here);  % the block takes a name on the path
load_system('simulink_extras');
if bdIsLoaded(model)
    close_system(model, 0);
end
new_system(model);

% ports in the order of the FMUs
plant_in = {'u', 'u_gain_x', 'u_gain_v', 'u_gain_z', 'u_gain_i', ...
            'u_ref_x', 'u_ref_v', 'u_ref_z', 'u_ref_i', 'u_rate'};
plant_out = {'x', 'v', 'z', 'i', 'friction'};
iol_in = {'x', 'v', 'z', 'i', 'x_d'};
iol_out = plant_in;

parts = {'plant', 'iol'};
for k = 1:2
    block = [model '/' parts{k}];
    add_block('simulink_extras/FMU Import/FMU', block, 'FMUName', [parts{k} '.fmu']);
    set_param(block, 'FMUMode', way);
    if strcmp(way, 'CoSimulation')
        set_param(block, 'FMUSampleTime', num2str(step));
    end
end
plant = get_param([model '/plant'], 'PortHandles');
iol = get_param([model '/iol'], 'PortHandles');
counts = [numel(plant.Inport), numel(plant.Outport), numel(iol.Inport), numel(iol.Outport)];
expected = [numel(plant_in), numel(plant_out), numel(iol_in), numel(iol_out)];
assert(isequal(counts, expected), 'ports: got %s, expected %s', ...
       mat2str(counts), mat2str(expected));

for k = 1:numel(iol_in)
    name = iol_in{k};
    if strcmp(name, 'x_d')
        add_block('simulink/Sources/Constant', [model '/x_d'], 'Value', num2str(goal));
        source = get_param([model '/x_d'], 'PortHandles');
        add_line(model, source.Outport(1), iol.Inport(k));
    else
        add_line(model, plant.Outport(strcmp(plant_out, name)), iol.Inport(k));
    end
end
for k = 1:numel(plant_in)
    name = plant_in{k};
    if strcmp(name, 'u') || strcmp(way, 'CoSimulation')
        add_line(model, iol.Outport(strcmp(iol_out, name)), plant.Inport(k));
    else
        add_block('simulink/Sources/Ground', [model '/no_' name]);
        source = get_param([model '/no_' name], 'PortHandles');
        add_line(model, source.Outport(1), plant.Inport(k));
    end
end

% what is compared; every other output that leads nowhere gets a terminator
shown = {'x', 'u'};
from = [plant.Outport(1), iol.Outport(1)];
for k = 1:2
    add_block('simulink/Sinks/Out1', [model '/' shown{k} '_out']);
    sink = get_param([model '/' shown{k} '_out'], 'PortHandles');
    add_line(model, from(k), sink.Inport(1));
end
add_block('simulink/Sinks/Terminator', [model '/friction']);
sink = get_param([model '/friction'], 'PortHandles');
add_line(model, plant.Outport(5), sink.Inport(1));
if strcmp(way, 'ModelExchange')
    for k = 2:numel(iol_out)
        add_block('simulink/Sinks/Terminator', [model '/end_' iol_out{k}]);
        sink = get_param([model '/end_' iol_out{k}], 'PortHandles');
        add_line(model, iol.Outport(k), sink.Inport(1));
    end
    set_param(model, 'SolverType', 'Variable-step', 'Solver', 'ode15s', ...
              'RelTol', '1e-6', 'AbsTol', '1e-8', 'MaxStep', '1e-2');
else
    set_param(model, 'SolverType', 'Fixed-step', 'Solver', 'FixedStepDiscrete', ...
              'FixedStep', num2str(step));
end

table = readtable(fullfile(here, 'iol_step.csv'));
set_param(model, 'StopTime', num2str(stop), 'SaveOutput', 'on', 'SaveFormat', 'Dataset', ...
          'ReturnWorkspaceOutputs', 'on');
if strcmp(way, 'ModelExchange')
    set_param(model, 'OutputOption', 'AdditionalOutputTimes', ...
              'OutputTimes', mat2str(table.time', 17));
end
result = sim(model);
x = result.yout{1}.Values;
u = result.yout{2}.Values;
[time, first] = unique(x.Time);
off = max(abs(interp1(time, x.Data(first), table.time) - table.x));
[time, first] = unique(u.Time);
off_u = max(abs(interp1(time, u.Data(first), table.time) - table.u));
fprintf('%s: x is off by %.2g m, u by %.2g V\n', way, off, off_u);
assert(off < allowed, 'x is off by more than %g m', allowed);
save_system(model, fullfile(here, model));
