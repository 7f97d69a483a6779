% One measurement of octave-control's n4sid; arguments: folder with data.mat, order, block rows.
% The answer is a line of JSON, as that of ident_worker.py.
pkg load control

function kb = status_kb (field)
  text = fileread ("/proc/self/status");
  kb = str2double (regexp (text, [field ":\\s+(\\d+)"], "tokens"){1}{1});
endfunction

arguments = argv ();
load (fullfile (arguments{1}, "data.mat"));
order = str2double (arguments{2});
rows = str2double (arguments{3});
[system, x0] = n4sid (iddata (y(1:400, :), u(1:400, :), 1/300), 2, "s", 4);
data = iddata (y, u, 1/300);
fid = fopen ("/proc/self/clear_refs", "w"); fputs (fid, "5"); fclose (fid);
before_kb = status_kb ("VmRSS");
start_s = cputime ();
[system, x0] = n4sid (data, order, "s", rows);
answer.cpu_s = cputime () - start_s;
answer.memory_mb = (status_kb ("VmHWM") - before_kb) / 1024;
[a, b, c, d] = ssdata (system);
answer.model = {a, b, c, d};
printf ("\n%s\n", jsonencode (answer, "ConvertInfAndNaN", false));
