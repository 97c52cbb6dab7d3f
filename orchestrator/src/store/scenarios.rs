//! Recipes and scenarios.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;

use env_core::{Recipe, Scenario, Seed};
use sqlx::{QueryBuilder, SqliteConnection, query};

use super::{StoreError, hex_list, signed, to_json, unsigned};

/// Rows of a statement.
const ROWS: usize = 32;

/// Stores recipes, once each.
///
/// # Errors
/// The database's.
pub async fn insert_recipes(conn: &mut SqliteConnection, recipes: &[&Recipe]) -> Result<(), StoreError> {
    let rows = recipes.iter().map(|recipe| Ok((recipe.id().0, to_json(&recipe.to_json())?)));
    // Scenarios that come together are often of few recipes.
    let rows = rows.collect::<Result<BTreeMap<_, _>, StoreError>>()?;
    for rows in rows.iter().collect::<Vec<_>>().chunks(ROWS) {
        let mut statement = QueryBuilder::new("INSERT INTO recipes (id, body) ");
        statement.push_values(rows, |mut values, (id, body)| {
            values.push_bind(id.as_slice()).push_bind(body);
        });
        statement.push(" ON CONFLICT (id) DO NOTHING").build().execute(&mut *conn).await?;
    }
    Ok(())
}

/// Stores scenarios and their recipes, once each.
///
/// # Errors
/// The database's.
pub async fn insert_all(conn: &mut SqliteConnection, scenarios: &[&Scenario]) -> Result<(), StoreError> {
    let recipes: Vec<&Recipe> = scenarios.iter().map(|scenario| &**scenario.recipe()).collect();
    insert_recipes(conn, &recipes).await?;
    for rows in scenarios.chunks(ROWS) {
        let mut statement = QueryBuilder::new("INSERT INTO scenarios (id, recipe, seed) ");
        statement.push_values(rows, |mut values, scenario| {
            values.push_bind(scenario.id().0.to_vec()).push_bind(scenario.recipe().id().0.to_vec());
            values.push_bind(signed(scenario.seed().get()));
        });
        statement.push(" ON CONFLICT (id) DO NOTHING").build().execute(&mut *conn).await?;
    }
    Ok(())
}

/// Stores a scenario and its recipe, once each.
///
/// # Errors
/// The database's.
pub async fn insert(conn: &mut SqliteConnection, scenario: &Scenario) -> Result<(), StoreError> {
    insert_all(conn, &[scenario]).await
}

/// The seed of a scenario.
///
/// # Errors
/// The database's.
pub async fn seed(conn: &mut SqliteConnection, id: &[u8]) -> Result<Option<u64>, StoreError> {
    let seed =
        sqlx::query_scalar!("SELECT seed FROM scenarios WHERE id = ?", id).fetch_optional(conn).await?;
    Ok(seed.map(unsigned))
}

/// Reads scenarios, each recipe once.
#[derive(Debug, Default)]
pub struct Loader {
    recipes: HashMap<Vec<u8>, Arc<Recipe>>,
}

/// Scenarios that were read together. One that cannot be brought back holds up no other.
#[derive(Debug, Default)]
pub struct Scenarios(HashMap<Vec<u8>, Result<Scenario, StoreError>>);

impl Scenarios {
    /// A scenario by its id.
    ///
    /// # Errors
    /// One that is not there, or cannot be read.
    pub fn get(&self, id: &[u8]) -> Result<&Scenario, StoreError> {
        match self.0.get(id) {
            Some(Ok(scenario)) => Ok(scenario),
            Some(Err(error)) => Err(StoreError::unreadable("a scenario", error)),
            None => Err(gone("a scenario")),
        }
    }
}

fn gone(what: &'static str) -> StoreError {
    StoreError::unreadable(what, "it is gone")
}

impl Loader {
    /// A scenario by its id.
    ///
    /// # Errors
    /// The database's, or a scenario that cannot be read.
    pub async fn get(&mut self, conn: &mut SqliteConnection, id: &[u8]) -> Result<Scenario, StoreError> {
        self.all(conn, &[id]).await?.get(id).cloned()
    }

    /// Scenarios by their ids, in two statements however many they are.
    ///
    /// # Errors
    /// The database's.
    pub async fn all<T: AsRef<[u8]>>(
        &mut self,
        conn: &mut SqliteConnection,
        ids: &[T],
    ) -> Result<Scenarios, StoreError> {
        let ids = hex_list(ids)?;
        let rows = query!(
            "SELECT id, recipe, seed FROM scenarios WHERE id IN (SELECT unhex(value) FROM json_each(?))",
            ids
        )
        .fetch_all(&mut *conn)
        .await?;
        let unknown =
            rows.iter().map(|row| row.recipe.as_slice()).filter(|id| !self.recipes.contains_key(*id));
        let unknown: BTreeSet<&[u8]> = unknown.collect();
        let bodies = bodies(conn, &unknown.into_iter().collect::<Vec<_>>()).await?;
        let scenarios = rows.into_iter().map(|row| {
            let recipe = self.parsed(&row.recipe, bodies.get(&row.recipe));
            let scenario =
                recipe.and_then(|recipe| Ok(Scenario::new(recipe, Seed::new(unsigned(row.seed))?)));
            (row.id, scenario)
        });
        Ok(Scenarios(scenarios.collect()))
    }

    /// A recipe by its id.
    ///
    /// # Errors
    /// The database's, or a recipe that cannot be read.
    pub async fn recipe(
        &mut self,
        conn: &mut SqliteConnection,
        id: &[u8],
    ) -> Result<Arc<Recipe>, StoreError> {
        let bodies = if self.recipes.contains_key(id) { HashMap::new() } else { bodies(conn, &[id]).await? };
        self.parsed(id, bodies.get(id))
    }

    /// A recipe that is known, or read from its body.
    fn parsed(&mut self, id: &[u8], body: Option<&String>) -> Result<Arc<Recipe>, StoreError> {
        if let Some(recipe) = self.recipes.get(id) {
            return Ok(Arc::clone(recipe));
        }
        let body = body.ok_or_else(|| gone("a recipe"))?;
        let value: serde_json::Value = super::from_json("a recipe", body)?;
        let recipe = Arc::new(Recipe::from_json(&value)?);
        self.recipes.insert(id.to_owned(), Arc::clone(&recipe));
        Ok(recipe)
    }
}

/// Recipes as they are stored, by their ids.
async fn bodies<T: AsRef<[u8]>>(
    conn: &mut SqliteConnection,
    ids: &[T],
) -> Result<HashMap<Vec<u8>, String>, StoreError> {
    if ids.is_empty() {
        return Ok(HashMap::new());
    }
    let ids = hex_list(ids)?;
    let rows =
        query!("SELECT id, body FROM recipes WHERE id IN (SELECT unhex(value) FROM json_each(?))", ids)
            .fetch_all(conn)
            .await?;
    Ok(rows.into_iter().map(|row| (row.id, row.body)).collect())
}
