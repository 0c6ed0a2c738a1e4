//! Text to graph.

use super::prior::gravity_of;
use super::{AnyPoseGraph, G2oError};
use crate::group::{PoseGroup, RotationError};
use crate::pose_graph::{Edge, LARGEST_INFORMATION, PoseGraph, Vertex, nearest_information};
use mapwright_geom::{FARTHEST_M, Pose, Pose2, Pose3};
use nalgebra::SMatrix;
use rustc_hash::FxHashMap;
use std::io::Read;

/// How far from one the norm of a quaternion may be before that is told.
const NORM_TOLERANCE: f64 = 1e-3;
/// Characters of a bad line that a message repeats.
const EXCERPT: usize = 60;

/// A graph and what had to be done to read it.
#[derive(Debug, Clone, PartialEq)]
pub struct G2oFile {
    /// The graph; every vertex has a pose.
    pub graph: AnyPoseGraph,
    /// What was odd.
    pub report: G2oReport,
}

/// What was odd about a file, and what was done about it.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct G2oReport {
    /// Lines of any kind.
    pub lines: usize,
    /// Vertices that only edges name; their poses follow from the edges.
    pub vertices_from_edges: usize,
    /// Vertices given again, of which the first counts.
    pub duplicate_vertices: usize,
    /// Edges from a vertex to itself, left out.
    pub self_edges: usize,
    /// Information that is not symmetric positive semidefinite, replaced by the nearest that is.
    pub indefinite_information: usize,
    /// Edges of files without any information, in which TORO and GTSAM take the identity, as is done here.
    pub without_information: usize,
    /// Edges whose information is zero; they say nothing.
    pub zero_information: usize,
    /// Quaternions whose norm is not one, normalised.
    pub unnormalised_quaternions: usize,
    /// `FIX` of vertices that are nowhere else.
    pub unknown_fixes: usize,
    /// Priors that are not of gravity alone, left out.
    pub other_priors: usize,
    /// Lines with a tag that is not known, left out.
    pub unknown_lines: usize,
    /// The first tag that is not known, and its line.
    pub first_unknown: Option<(String, usize)>,
}

/// Reads a graph whose information is as the metric says.
///
/// # Errors
/// The stream fails, a line with a known tag is not what the tag says (numbers missing, not finite or too large), plane
/// and space are mixed, or there is nothing.
pub fn read_g2o(mut stream: impl Read, metric: RotationError) -> Result<G2oFile, G2oError> {
    let mut bytes = Vec::new();
    stream.read_to_end(&mut bytes)?;
    let mut planar = Collector::<Pose2>::default();
    let mut spatial = Collector::<Pose3>::default();
    (planar.graph.metric, spatial.graph.metric) = (metric, metric);
    let information = match metric {
        RotationError::QuaternionVector => quaternion_information,
        RotationError::RotationVector => upper_triangle,
    };
    let mut report = G2oReport::default();
    let mut fixes = Vec::new();
    let mut lines = bytes.split(|&b| b == b'\n').collect::<Vec<_>>();
    if lines.last().is_some_and(|last| last.is_empty()) {
        lines.pop();
    }
    report.lines = lines.len();
    for (at, text) in lines.into_iter().enumerate() {
        let mut line = Line::new(at + 1, text);
        match line.tag {
            b"VERTEX_SE2" | b"VERTEX2" => planar.vertex(&mut line, &mut report, planar_pose)?,
            b"EDGE_SE2" => planar.edge(&mut line, &mut report, planar_pose, planar_information)?,
            b"EDGE2" => planar.edge(&mut line, &mut report, planar_pose, toro_planar_information)?,
            b"VERTEX_SE3:QUAT" => spatial.vertex(&mut line, &mut report, quaternion_pose)?,
            b"EDGE_SE3:QUAT" => spatial.edge(&mut line, &mut report, quaternion_pose, information)?,
            b"PARAMS_SE3OFFSET" => spatial.sensor(&mut line, &mut report)?,
            b"EDGE_SE3_PRIOR" => spatial.prior(&mut line, &mut report, information)?,
            b"VERTEX3" => spatial.vertex(&mut line, &mut report, euler_pose)?,
            b"EDGE3" => spatial.edge(&mut line, &mut report, euler_pose, upper_triangle)?,
            b"FIX" => line.ids(&mut fixes)?,
            b"" => {}
            tag if tag.starts_with(b"#") => {}
            tag => {
                report.unknown_lines += 1;
                report.first_unknown.get_or_insert_with(|| (excerpt(tag), line.number));
            }
        }
        if !planar.is_empty() && !spatial.is_empty() {
            return Err(line.error("vertices and edges all of the plane or all of space"));
        }
    }
    let graph = match (planar.is_empty(), spatial.is_empty()) {
        (false, _) => AnyPoseGraph::Planar(planar.finish(&fixes, &mut report)),
        (true, false) => AnyPoseGraph::Spatial(spatial.finish(&fixes, &mut report)),
        (true, true) => {
            let first_unknown = report.first_unknown.map(|(tag, _)| tag);
            return Err(G2oError::Empty { lines: report.lines, first_unknown });
        }
    };
    Ok(G2oFile { graph, report })
}

/// What has been read so far.
struct Collector<P: Pose> {
    graph: PoseGraph<P>,
    known: Vec<bool>,
    places: FxHashMap<u64, usize>,
    /// Where sensors sit at a vertex, by their ids.
    sensors: FxHashMap<u64, P>,
    /// Edges that say how far they are to be believed.
    with_information: usize,
}

impl<P: Pose> Default for Collector<P> {
    fn default() -> Self {
        Self {
            graph: PoseGraph::default(),
            known: Vec::new(),
            places: FxHashMap::default(),
            sensors: FxHashMap::default(),
            with_information: 0,
        }
    }
}

type ReadPose<P> = fn(&mut Line<'_>, &mut G2oReport) -> Result<P, G2oError>;
type ReadInformation<const D: usize> = fn(&mut Line<'_>) -> Result<SMatrix<f64, D, D>, G2oError>;

impl<P: Pose> Collector<P> {
    fn is_empty(&self) -> bool {
        self.graph.vertices.is_empty()
    }

    fn place(&mut self, id: u64) -> usize {
        let (vertices, known) = (&mut self.graph.vertices, &mut self.known);
        *self.places.entry(id).or_insert_with(|| {
            vertices.push(Vertex { id, world_from_vertex: P::default(), fixed: false });
            known.push(false);
            vertices.len() - 1
        })
    }

    fn vertex(&mut self, line: &mut Line<'_>, report: &mut G2oReport, pose: ReadPose<P>) -> Result<(), G2oError> {
        let id = line.id()?;
        let world_from_vertex = pose(line, report)?;
        line.end()?;
        let place = self.place(id);
        if self.known[place] {
            report.duplicate_vertices += 1;
        } else {
            self.known[place] = true;
            self.graph.vertices[place].world_from_vertex = world_from_vertex;
        }
        Ok(())
    }

    fn edge<const D: usize>(
        &mut self,
        line: &mut Line<'_>,
        report: &mut G2oReport,
        pose: ReadPose<P>,
        information: ReadInformation<D>,
    ) -> Result<(), G2oError>
    where
        P: PoseGroup<D>,
    {
        let (from, to) = (line.id()?, line.id()?);
        let from_from_to = pose(line, report)?;
        let (information, repaired) = if line.is_at_end() && self.with_information == 0 {
            report.without_information += 1;
            (SMatrix::identity(), false)
        } else if report.without_information > 0 {
            return Err(line.error("no information, as in the edges before"));
        } else {
            self.with_information += 1;
            nearest_information(&information(line)?)
        };
        line.end()?;
        report.indefinite_information += usize::from(repaired);
        report.zero_information += usize::from(information.iter().all(|&v| v == 0.0));
        let (from, to) = (self.place(from), self.place(to));
        if from == to {
            report.self_edges += 1;
        } else {
            self.graph.edges.push(Edge { from, to, from_from_to, information });
        }
        Ok(())
    }

    fn finish(mut self, fixes: &[u64], report: &mut G2oReport) -> PoseGraph<P> {
        for id in fixes {
            match self.places.get(id) {
                Some(&place) => self.graph.vertices[place].fixed = true,
                None => report.unknown_fixes += 1,
            }
        }
        report.vertices_from_edges = self.known.iter().filter(|known| !**known).count();
        if report.vertices_from_edges > 0 {
            self.graph.fill_poses(&self.known);
        }
        self.graph
    }
}

impl Collector<Pose3> {
    fn sensor(&mut self, line: &mut Line<'_>, report: &mut G2oReport) -> Result<(), G2oError> {
        let id = line.id()?;
        let vertex_from_sensor = quaternion_pose(line, report)?;
        line.end()?;
        self.sensors.insert(id, vertex_from_sensor);
        Ok(())
    }

    fn prior(
        &mut self,
        line: &mut Line<'_>,
        report: &mut G2oReport,
        information: ReadInformation<6>,
    ) -> Result<(), G2oError> {
        let (vertex, sensor) = (line.id()?, line.id()?);
        let world_from_sensor = quaternion_pose(line, report)?;
        let (information, repaired) = nearest_information(&information(line)?);
        line.end()?;
        let Some(&vertex_from_sensor) = self.sensors.get(&sensor) else {
            return Err(line.error(&format!("a sensor that a line PARAMS_SE3OFFSET {sensor} before says the place of")));
        };
        report.indefinite_information += usize::from(repaired);
        let vertex = self.place(vertex);
        match gravity_of(vertex, vertex_from_sensor, world_from_sensor, &information) {
            Some(gravity) => self.graph.gravity.push(gravity),
            None => report.other_priors += 1,
        }
        Ok(())
    }
}

fn planar_pose(line: &mut Line<'_>, _: &mut G2oReport) -> Result<Pose2, G2oError> {
    Ok(Pose2::new(line.metres()?, line.metres()?, line.metres()?))
}

fn quaternion_pose(line: &mut Line<'_>, report: &mut G2oReport) -> Result<Pose3, G2oError> {
    let translation = line.three()?;
    let [x, y, z] = line.three()?;
    let w = line.metres()?;
    let norm = (x * x + y * y + z * z + w * w).sqrt();
    report.unnormalised_quaternions += usize::from((norm - 1.0).abs() > NORM_TOLERANCE);
    Pose3::from_quaternion(translation, [x, y, z, w]).ok_or_else(|| line.error("a quaternion that is not zero"))
}

/// TORO's `x y z roll pitch yaw`.
fn euler_pose(line: &mut Line<'_>, _: &mut G2oReport) -> Result<Pose3, G2oError> {
    let translation = line.three()?.into();
    let [roll, pitch, yaw] = line.three()?;
    Ok(Pose3 { translation, rotation: nalgebra::UnitQuaternion::from_euler_angles(roll, pitch, yaw) })
}

/// g2o's order: the upper triangle, row by row.
fn planar_information(line: &mut Line<'_>) -> Result<SMatrix<f64, 3, 3>, G2oError> {
    upper_triangle(line)
}

/// TORO's order: `xx xy yy tt xt yt`.
fn toro_planar_information(line: &mut Line<'_>) -> Result<SMatrix<f64, 3, 3>, G2oError> {
    let [xx, xy, yy] = line.three_of_information()?;
    let [tt, xt, yt] = line.three_of_information()?;
    Ok(SMatrix::<f64, 3, 3>::new(xx, xy, xt, xy, yy, yt, xt, yt, tt))
}

fn quaternion_information(line: &mut Line<'_>) -> Result<SMatrix<f64, 6, 6>, G2oError> {
    Ok(scaled_rotations(&upper_triangle(line)?, 0.5))
}

/// Information after the rotations' coordinates are divided by a scale: that of half angles is four times as large.
pub(super) fn scaled_rotations(information: &SMatrix<f64, 6, 6>, scale: f64) -> SMatrix<f64, 6, 6> {
    let factor = |k: usize| if k < 3 { 1.0 } else { scale };
    SMatrix::from_fn(|r, c| information[(r, c)] * factor(r) * factor(c))
}

fn upper_triangle<const D: usize>(line: &mut Line<'_>) -> Result<SMatrix<f64, D, D>, G2oError> {
    let mut matrix = SMatrix::<f64, D, D>::zeros();
    for r in 0..D {
        for c in r..D {
            let value = line.information()?;
            (matrix[(r, c)], matrix[(c, r)]) = (value, value);
        }
    }
    Ok(matrix)
}

/// A line that is being taken apart.
struct Line<'a> {
    number: usize,
    tag: &'a [u8],
    text: &'a [u8],
    rest: &'a [u8],
}

impl<'a> Line<'a> {
    fn new(number: usize, text: &'a [u8]) -> Self {
        let mut line = Self { number, tag: b"", text, rest: text };
        line.tag = line.word().unwrap_or_default();
        line
    }

    fn word(&mut self) -> Option<&'a [u8]> {
        let rest = self.rest.trim_ascii_start();
        let length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        let (word, rest) = rest.split_at(length);
        self.rest = rest;
        (!word.is_empty()).then_some(word)
    }

    fn parse<T: std::str::FromStr>(&mut self, expected: &str) -> Result<T, G2oError> {
        let word = self.word().ok_or_else(|| self.error(&format!("{expected}, and more of them")))?;
        let text = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
        text.ok_or_else(|| self.error_at(expected, word))
    }

    fn id(&mut self) -> Result<u64, G2oError> {
        self.parse("the id of a vertex, a whole number")
    }

    fn ids(&mut self, ids: &mut Vec<u64>) -> Result<(), G2oError> {
        ids.push(self.id()?);
        while !self.rest.trim_ascii().is_empty() {
            ids.push(self.id()?);
        }
        Ok(())
    }

    fn number(&mut self, expected: &str, largest: f64) -> Result<f64, G2oError> {
        let before = self.rest;
        let value: f64 = self.parse(expected)?;
        // not `>`: NaN must fail
        if value.abs() <= largest {
            return Ok(value);
        }
        let mut again = Self { rest: before, ..*self };
        Err(self.error_at(expected, again.word().unwrap_or_default()))
    }

    fn metres(&mut self) -> Result<f64, G2oError> {
        self.number("a number within 10^6", FARTHEST_M)
    }

    fn three(&mut self) -> Result<[f64; 3], G2oError> {
        Ok([self.metres()?, self.metres()?, self.metres()?])
    }

    fn information(&mut self) -> Result<f64, G2oError> {
        self.number("an entry of the information matrix within 10^15", LARGEST_INFORMATION)
    }

    fn three_of_information(&mut self) -> Result<[f64; 3], G2oError> {
        Ok([self.information()?, self.information()?, self.information()?])
    }

    fn is_at_end(&self) -> bool {
        self.rest.trim_ascii().is_empty()
    }

    fn end(&mut self) -> Result<(), G2oError> {
        match self.word() {
            None => Ok(()),
            Some(word) => Err(self.error_at("the end of the line", word)),
        }
    }

    fn error(&self, expected: &str) -> G2oError {
        self.error_at(expected, self.text)
    }

    fn error_at(&self, expected: &str, found: &[u8]) -> G2oError {
        G2oError::Line { line: self.number, expected: expected.to_owned(), found: excerpt(found) }
    }
}

/// Some bytes as a message can show them.
fn excerpt(bytes: &[u8]) -> String {
    let text = String::from_utf8_lossy(bytes.trim_ascii());
    let shown: String = text.chars().take(EXCERPT).flat_map(char::escape_default).collect();
    let more = if text.chars().nth(EXCERPT).is_some() { "..." } else { "" };
    format!("\"{shown}{more}\"")
}
