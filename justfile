# list what there is
_default:
    @"{{just_executable()}}" --list --unsorted

# everything CI runs, in its order
check:
    .ci/run

# put the code into form
fmt:
    cargo fmt --all

# lints, warnings denied
lint:
    cargo clippy --workspace --all-targets --features mapwright-cli/net,mapwright-cli/view,mapwright-cli/zenoh -- -D warnings

# all tests
test:
    cargo test --workspace --features mapwright-cli/net,mapwright-cli/view,mapwright-cli/zenoh

# documentation, warnings denied
doc:
    RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps

# arrows between crates, circles within them, effects, licences
arrows:
    cargo xtask arrows

# licences, sources and bans, by cargo-deny
deny:
    cargo deny check bans licenses sources

data_all := env("MAPWRIGHT_DATA", "../shared/data")
data := data_all / "2d_benchmark"
figures := env("CARGO_TARGET_DIR", "target") / "figures"
mapwright := env("CARGO_TARGET_DIR", "target") / "release/mapwright"
starts := "0,0,0 0.011,0.023,0.3 0.027,0.041,0.8 0.034,0.012,1.2 0.043,0.031,1.7 -0.013,0.022,2.3 -0.024,-0.036,-0.6 -0.031,-0.017,-2.5"

# a build, or two beside each other, by distributions over all real logs: just judge target/release/mapwright [OTHER] --day both
judge *args:
    python3 scripts/judge.py {{data_all}} {{args}}

# a simulated office floor, mapped and compared with the truth
demo *args:
    cargo run --release -- demo {{args}}

# the README's picture (Python with Pillow packs it losslessly)
demo-picture: release
    {{mapwright}} demo -o {{figures}}/demo
    python3 -c "from PIL import Image; Image.open('{{figures}}/demo/map.png').save('docs/demo.png', optimize=True)"

# the page's picture in docs/images: intel, with a closure chosen (Chromium; Python with Pillow packs it)
page-picture: release
    #!/usr/bin/env bash
    set -euo pipefail
    {{mapwright}} map {{data}}/intel.clf.bz2 -o {{figures}}/intel --quiet
    {{mapwright}} report {{figures}}/intel
    chromium --headless --no-sandbox --disable-gpu --hide-scrollbars --window-size=1280,1000 --virtual-time-budget=3000 \
        --screenshot={{figures}}/report.png "file://$(realpath {{figures}})/intel/report.html#closure=a-2"
    python3 -c "from PIL import Image; Image.open('{{figures}}/report.png').convert('RGB').quantize(256, method=Image.Quantize.MAXCOVERAGE).save('docs/images/report.png', optimize=True)"

# the optimised binary
release:
    cargo build --release -p mapwright-cli

# a Debian package, a static binary and a container image, as far as they can be built here, into target/package; or those that are named
package *what:
    scripts/package.sh {{what}}

# intel and fr079 beside GMapping's poses, and the CPU that they take
figures-beside: release
    COMPARE_2D={{figures}}/compare_2d python3 scripts/compare_2d.py {{mapwright}} {{data}}

# relation errors over 8 start poses; further arguments go to `mapwright map`
figures-starts log *args: release
    #!/usr/bin/env bash
    set -euo pipefail
    trajectories=()
    for start in {{starts}}; do
        out="{{figures}}/{{log}}/$start"
        {{mapwright}} map "{{data}}/{{log}}.clf.bz2" -o "$out" --start="$start" --quiet {{args}} || [ $? = 3 ]
        trajectories+=("$out/trajectory.tum")
    done
    {{mapwright}} eval "${trajectories[@]}" --relations "{{data}}/{{log}}.relations" | grep -E '^over|  (all|>|<)'

# intel: with the defaults, everything live, without odometry
figures-intel: (figures-starts "intel") (figures-starts "intel" "--set" "live.policy=everything") (figures-starts "intel" "--no-odometry")

# fr079: the same
figures-fr079: (figures-starts "fr079") (figures-starts "fr079" "--set" "live.policy=everything") (figures-starts "fr079" "--no-odometry")

# a harder version of a log, mapped and scored; arguments as of `mapwright perturb`
figures-perturbed log *args: release
    mkdir -p {{figures}}
    {{mapwright}} perturb {{data}}/{{log}}.clf.bz2 -o {{figures}}/harder.clf {{args}}
    {{mapwright}} map {{figures}}/harder.clf -o {{figures}}/harder || [ $? = 3 ]
    {{mapwright}} eval {{figures}}/harder/trajectory.tum --relations {{data}}/{{log}}.relations

# intel made harder: fewer scans, wrong odometry, random beams
figures-robustness: (figures-perturbed "intel" "--every" "2") (figures-perturbed "intel" "--every" "5") (figures-perturbed "intel" "--scale-odometry" "1.1") (figures-perturbed "intel" "--noise-beams" "0.1") (figures-perturbed "intel" "--noise-beams" "0.3")

# a log with noise on every increment of odometry, over ten seeds: each, the mean and the worst
figures-noise log amount *args: release
    {{mapwright}} suite noise --log {{data}}/{{log}}.clf.bz2 --relations {{data}}/{{log}}.relations --amount {{amount}} {{args}}

# a log with gaps of 3 to 120 s, each by itself: the error beside the whole log's, scans left out, the time it takes
figures-breaks log *args: release
    {{mapwright}} suite breaks {{data}}/{{log}}.clf.bz2 --relations {{data}}/{{log}}.relations {{args}}

# 50 loops of 500 m: closed or not, and the error beside that of a batch solve with all true closures
suite-loops *args: release
    {{mapwright}} suite loops -o {{figures}}/suite {{args}}

# 20 drives of 1.9 km in nested loops of corridors that look alike: wrong closures, and the error
suite-nested *args: release
    {{mapwright}} suite nested -o {{figures}}/suite {{args}}

# 200 buildings made to deceive: wrong closures, and true returns found
suite-look-alike *args: release
    {{mapwright}} suite look-alike -o {{figures}}/suite {{args}}

# 100 robots located in a finished map, half of them where two places look alike: after how long, and how often wrongly
suite-localise *args: release
    {{mapwright}} suite localise -o {{figures}}/suite {{args}}

# 50 office floors with people in them: the error
suite-offices *args: release
    {{mapwright}} suite offices -o {{figures}}/suite {{args}}

# 50 drives through apartments with cheap lasers, on wheels and by hand
suite-homes *args: release
    {{mapwright}} suite homes -o {{figures}}/suite {{args}}

# 100 teams of robots over bad radios: identical maps, no wrong join
suite-fleet *args: release
    {{mapwright}} suite fleet -o {{figures}}/suite {{args}}

# The same, cut in two until after all have driven
suite-partition *args: release
    {{mapwright}} suite partition -o {{figures}}/suite {{args}}

# 72 teams in which one robot lies: the others' error beside the same team with nobody lying
suite-liars *args: release
    {{mapwright}} suite liars -o {{figures}}/suite {{args}}

# 100 robots that somebody pushes: legs and posts left out, nothing wrong called good
suite-legs *args: release
    {{mapwright}} suite legs -o {{figures}}/suite {{args}}

# 100 robots carried away: noticed, written while lost, home found
suite-kidnapped *args: release
    {{mapwright}} suite kidnapped -o {{figures}}/suite {{args}}

# an office floor with gaps of 3 to 120 s in its log: the error, scans left out, the time it takes
suite-breaks *args: release
    {{mapwright}} suite breaks -o {{figures}}/suite {{args}}

# drives in space: whether the stated covariances are honest
suite-drives *args: release
    {{mapwright}} suite drives --3d -o {{figures}}/suite {{args}}

# where the time goes on intel, decompressed: seconds per stage, of the fastest of five runs
figures-time *args: release
    #!/usr/bin/env bash
    set -euo pipefail
    mkdir -p {{figures}}
    bzip2 -dkc {{data}}/intel.clf.bz2 > {{figures}}/intel.clf
    for _ in 1 2 3 4 5; do
        {{mapwright}} map {{figures}}/intel.clf -o {{figures}}/time --quiet {{args}}
        tr -d ' "\n' < {{figures}}/time/timing.json | sed 's/.*total_s:\([0-9.]*\).*stages_s:{\([^}]*\)}.*/\1 \2\n/'
    done | sort -n | head -1 | tr ', :' '\n\n ' | sed '1s/^/total /'

# instructions of kernels and of a whole log, counted by valgrind, against those allowed
instructions:
    .ci/instructions

# criterion's benchmarks: kernels, whole logs, reading and writing
bench:
    cargo bench -p mapwright -p mapwright-grid -p mapwright-formats -p mapwright-sim \
        --bench whole_log --bench kernels --bench carmen --bench map --bench raycast

# speed and memory on intel, decompressed; the best of five runs counts
figures-speed *args: release
    #!/usr/bin/env bash
    set -euo pipefail
    mkdir -p {{figures}}
    bzip2 -dkc {{data}}/intel.clf.bz2 > {{figures}}/intel.clf
    for _ in 1 2 3 4 5; do
        ( time {{mapwright}} map {{figures}}/intel.clf -o {{figures}}/speed {{args}} | grep speed ) 2>&1 | grep -E 'speed|user'
    done
